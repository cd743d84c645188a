"""The mechanism as symbols: a 6-UPS hexapod's kinematics and dynamics, built once for all."""
