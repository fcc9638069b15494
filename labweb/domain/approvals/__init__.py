"""Who may do what, and which plans need a person."""
