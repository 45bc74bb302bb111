"""The experiment file: strict schemas, and their conversion to mm and rad."""
