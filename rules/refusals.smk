"""Files that were asked for without their accuracy level, and words and names that mean nothing."""


rule without_level:
    input:
        lambda w: flow.refuse(w.scene, w.rest),
    output:
        "outputs/{scene}/{rest}",
    wildcard_constraints:
        scene=r"(?!studies/)[A-Za-z0-9_-]+|studies/[A-Za-z0-9_]+",
        rest=rf"(?!({flow.any_level})/|compare_({flow.any_level})(_({flow.any_level}))+\.(html|png|csv)$).+",


rule unknown:
    input:
        lambda w: flow.unknown(w.word),
    output:
        "{word}",
    wildcard_constraints:
        word=r"[^/.]+",


rule impossible_name:
    input:
        lambda w: flow.refuse(w.scene, w.rest),
    output:
        "outputs/{scene}/{rest}",
    wildcard_constraints:
        scene=r"[^/]*[^/A-Za-z0-9_-][^/]*",
        rest=".+",
