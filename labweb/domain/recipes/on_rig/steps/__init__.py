"""Steps of a recipe as actions on a rig: liquids, gases, heat, parting, instruments, rounds."""
