"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
GROUPS = {"length": "length", "lens": "lens", "wall": "buckle and staphyloma", "mesh": "a mesh from elsewhere"}
TOUCHED_BY_EYE = ("eye", "posture", "fill [%]", "part", "covered [%]", "low [%]", "high [%]")
VOLUME, ROW = "volume of the cavity", "eye_row"
