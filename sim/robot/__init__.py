"""The virtual robot, its controller and what stands between encoder and plate."""
