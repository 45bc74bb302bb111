"""From images to measurements, and experiments on rendered images."""
