"""What a real car has to bear and a simulated one can be given: light, optics, timing, steering, odometry."""

from ndtorch_robot.sim.stress.options import STRESSES, Stress, read_stress

__all__ = ["STRESSES", "Stress", "read_stress"]
