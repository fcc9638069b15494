"""What each unit operation is made of: the form between a recipe and the routes of a rig."""
