"""What leaves the program: files and folders that are whole or as they were, and nobody else's."""
