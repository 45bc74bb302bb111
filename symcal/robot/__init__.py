"""A serial robot: its data, its file, its link conventions, and URDF."""
