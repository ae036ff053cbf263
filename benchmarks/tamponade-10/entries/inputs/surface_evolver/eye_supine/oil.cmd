
autopop off
mend := { u; V; u; V; }
evolve := { g 8; mend; g 8; }
quiet
evolve 5
r
evolve 4
cut := { refine edges ee where ee.length > 0.5 and (1)*ee.vertex[1].z > 3.0 and on_constraint 1; }
finer := { refine edges ee where ee.length > 0.34 and (1)*ee.vertex[1].z > 3.0 and on_constraint 1; }
smooth := { u; V; g 5; u; V; g 5; }
cut
smooth
cut
smooth
evolve 3
U
g 250
U
finer
smooth
evolve
U
g 150
U

foreach facet ff where ff.color == 4 do printf "%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g \n", ff.vertex[1].x, ff.vertex[1].y, ff.vertex[1].z, ff.vertex[2].x, ff.vertex[2].y, ff.vertex[2].z, ff.vertex[3].x, ff.vertex[3].y, ff.vertex[3].z >> "wall.txt"

foreach facet ff where ff.color == 1 do printf "%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g \n", ff.vertex[1].x, ff.vertex[1].y, ff.vertex[1].z, ff.vertex[2].x, ff.vertex[2].y, ff.vertex[2].z, ff.vertex[3].x, ff.vertex[3].y, ff.vertex[3].z >> "free.txt"
q
q
