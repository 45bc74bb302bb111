"""A measurement that is led: pose by pose, each reading checked at once, until the accuracy that is wanted is sure."""
