"""The shipped models: URDF, SRDF and YAML, authored from published figures in primitive shapes."""
