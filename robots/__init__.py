"""Ground floor: hands, robots, scene, inverse kinematics, motion, trajectories."""
