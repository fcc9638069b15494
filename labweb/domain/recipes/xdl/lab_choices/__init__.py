"""What a recipe leaves open about a lab: stated by a person, or chosen by its rig."""
