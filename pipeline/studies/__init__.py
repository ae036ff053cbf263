"""The engine of studies: families of cases, their plan, their report, and the cost of accuracy."""
