"""What shapes at rest were checked against, in sentences for pages. Numbers: docs/methods/equilibrium.md."""

SIMULATED = ("A second and coarser method, simulations that resolve 1 mm, keeps the shape and touches 1 to 4 points "
             "less of the inferior half. From level oil it does not find the shape where the patient sits (7 to 15 "
             "points less), likely since the front edges are finer; where the patient lies it is 1 to 4 points off.")
CHECKED = (
    "In spheres, at 70 to 95 % and 10 to 25 degrees, the arc that the oil touches is at most 3 degrees and a covered "
    "share at most 1.2 percentage points off the exact solution of Young and Laplace (docs/methods/equilibrium.md, and "
    "so below).",
    "In the average eye, upright, at 85 %, light oil touches 68 % of the retina and 37 % of its inferior half; another "
    "program, Surface Evolver, finds 67 and 34 %.",
    SIMULATED,
    "Nothing was compared with patients, or with an experiment in an eye.",
)
