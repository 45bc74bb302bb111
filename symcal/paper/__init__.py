"""The study of [Ding2017]: its two simulations on plans of four kinds, repeated until chance is out of the numbers."""
