"""Files of people: YAML documents whose errors name their line, and tables of numbers with units in their headers."""
