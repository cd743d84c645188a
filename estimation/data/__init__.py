"""Measured data: what a recording holds, and how files of many formats become one."""
