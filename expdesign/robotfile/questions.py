"""What is asked in a robot file where nobody has told: what it is, and where to look."""

from __future__ import annotations

from expdesign.configuration.limits import CHARACTERISTIC_LENGTH

INERTIA = "Which inertia have motor, coupling and screw about their axis, inertia: 6.3e-5 [kg m^2]?"
"""Of a screw or gear."""

QUESTIONS = {
    "home": "How high is the TCP over the base's origin at home, and how does the platform stand "
    "there? Drawing, or the controller's kinematic parameters. A platform that hangs has z < 0.",
    "base_joints": "Where are the six joints at the base? Drawing or calibration sheet.",
    "platform_joints": "Where are the six joints at the platform, from the TCP? A tool on the "
    "platform moves the TCP, and with it all of them.",
    "alpha_axes": "How do the universal joints stand in the base?",
    "drive": "What moves the struts: direct drives, screws or gears, of which lead and inertia?",
    "moved_mass": "What does the platform weigh, with all that it carries?",
    "bodies": "What does CAD say of masses, centres and inertias? Where it says assumed, the "
    "bodies are a disc through the platform's joints, and in each strut two rods of 8 % and 4 % of "
    "its mass and a ring.",
    "parameters": "How much friction have drives and joints? Where it says assumed, it is dry "
    "friction of 5 % of the weight, and as much viscous friction at full speed.",
    "force_std": "How noisy is the measured force of each strut, or motor current times force "
    "constant? Hold still, record some seconds: `expdesign noise` makes these lines of it.",
    "length_std": "How noisy is the measured length of each strut? Resolution of the encoder.",
    "strut_length": "Between which lengths may each strut move, from joint to joint? Stroke of the "
    "drive, less the way to its switches.",
    "strut_speed": "How fast may a strut move? Data sheet of the drive, or the controller's limit.",
    "strut_acceleration": "How fast may a strut accelerate? The controller's limit.",
    "actuator_force": "Which force does a drive hold for as long as the experiment takes? "
    "Continuous force or current of its data sheet; behind a screw 2 pi torque / lead.",
    "position": "Where may the TCP go without touching anything?",
    "rotation": "How far may the platform rotate about each axis? Mind cables and hoses.",
    "tilt": "How far may the platform lean?",
    "alpha": "How far do the universal joints turn about their first axes? Zero at home.",
    "beta": "How far do the universal joints turn about their second axes?",
    "platform_joint_angle": "How far do the joints at the platform bend, from where they stand at "
    "home? Data sheet of the joints.",
    "jacobian_condition": "How close to a singular pose may it come?",
    "strut_clearance": "How thick are the struts? Their diameter and some reserve: it is the "
    "distance of their axes.",
    CHARACTERISTIC_LENGTH: "",
}
"""By key of the robot file, those of limits and noise by themselves."""
