"""What is measured on a robot and what is unknown: the parameters, and the symbolic model compiled for them."""
