"""What physics says of planned grasps: trials in MuJoCo, which knows nothing of what the planner took for granted."""
