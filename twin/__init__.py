"""The 3D scene of a lab, and the checks made before anything in it moves."""
