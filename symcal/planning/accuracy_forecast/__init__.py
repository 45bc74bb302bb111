"""How accurate a plan will make the robot: predictions, random plans, and a bound that no plan is below."""
