"""Images: the only rooms that import OpenCV."""
