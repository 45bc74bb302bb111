"""Proven bounds of the largest tr(I(q) W) over a box of joint readings, and of what a plan can be worth at best."""
