"""Names of all topics that the nodes use, relative but for those that ROS itself makes absolute."""

from __future__ import annotations

# Inputs.
SCAN = "scan"  # sensor_msgs/LaserScan; the parameter `scans` may name others
IMAGE = "image_raw"  # sensor_msgs/Image or CompressedImage; the parameter `images` may name others
MAP = "map"  # nav_msgs/OccupancyGrid, latched
LOCALISATION = "amcl_pose"  # geometry_msgs/PoseWithCovarianceStamped, base in world
CLOCK = "/clock"  # of simulated time
TF = "/tf"
TF_STATIC = "/tf_static"

# From cues to the tracker.
ANNOUNCEMENTS = "people_fusion/announcements"  # people_fusion/MeasurementAnnouncement of every cue
DETECTIONS = "people_fusion/detections"  # people_fusion/DetectedPersons of every cue
HEAD_SCORES = "people_fusion/head_scores"  # people_fusion/HeadScores of head cues, if the preset's tracker takes them
DETECTION_MARKERS = "people_fusion/detection_markers"  # visualization_msgs/MarkerArray
DEBUG = "people_fusion/debug"  # and the name of a cue of images: sensor_msgs/Image with what it did
DEBUG_POINTS = "points"  # beneath that of an RGB-D cue: sensor_msgs/PointCloud2

# From the tracker.
TRACKS = "people_fusion/tracks"  # people_fusion/TrackedPersons
HYPOTHESES = "people_fusion/hypotheses"  # people_fusion/TrackedPersons, unconfirmed ones, too: where cues look
PREVIEW = "people_fusion/tracks_preview"  # people_fusion/TrackedPersons, to be revised; policy `revisable` alone
POSES = "people_fusion/poses"  # geometry_msgs/PoseArray
MARKERS = "people_fusion/markers"  # visualization_msgs/MarkerArray
LEG_MARKERS = "people_fusion/leg_markers"  # visualization_msgs/MarkerArray; of trackers that follow legs
PARTICLES = "people_fusion/particles"  # people_fusion/TrackParticles; of trackers that have some
PARTICLE_MARKERS = "people_fusion/particle_markers"  # visualization_msgs/MarkerArray; of trackers that have some
PEOPLE = "people_fusion/people"  # people_msgs/People, where that package is installed
SPENCER_TRACKS = "people_fusion/spencer_tracks"  # spencer_tracking_msgs/TrackedPersons, where that package is installed

# With `compatible: strands`, what listeners of the STRANDS people tracker know.
STRANDS_PEOPLE = "people_tracker/people"
STRANDS_POSES = "people_tracker/pose_array"
STRANDS_NEAREST = "people_tracker/pose"
STRANDS_MARKERS = "people_tracker/marker_array"
