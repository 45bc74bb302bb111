"""Ways out of Python: files for controllers and other programs, all in the base frame unless asked otherwise."""
