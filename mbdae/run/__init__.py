"""From a scene and an accuracy to a run with its error and its warnings; `job` lists the modules in order."""
