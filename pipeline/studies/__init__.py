"""The engine of studies: families of cases, their plan, their report, and what pages of questions have in common."""
