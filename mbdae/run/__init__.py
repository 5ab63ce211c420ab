"""From a scene and an accuracy to a judged run; `job` begins."""
