"""Names of the files in the folder of a run; imports nothing, so that a help text may name them."""

TRAJECTORY, METRICS, PARAMETERS = "trajectory.txt", "metrics.json", "params.yaml"
REPORT = "report.html"
KEYFRAMES, KEYFRAMES_GTSAM = "keyframes.g2o", "keyframes_gtsam.g2o"
RESULTS = (TRAJECTORY, METRICS, PARAMETERS, REPORT, KEYFRAMES, KEYFRAMES_GTSAM)
"""What each run writes."""

ODOMETRY, CLOUD = "odometry.txt", "map.ply"
"""Of a mapping: the trajectory before loops were closed, and the coloured cloud."""

LOG = "node.log"
"""Of a demonstration: what its node said."""

OF_SOME_RUNS = (ODOMETRY, CLOUD, LOG)
"""What a run that does not write it leaves as it is."""
