"""Cameras as numbers and files: models, targets and boards, poses from three points. Nothing here needs OpenCV."""
