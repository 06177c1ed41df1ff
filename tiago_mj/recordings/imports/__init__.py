"""Importers: public recordings of real robots, and ROS bags, become recordings of this package."""
