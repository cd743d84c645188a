"""What is told of a loop that is lost."""

import numpy as np
import pytest

from estimation.feedforward.closed_loop import (
    Controller,
    ForwardDynamics,
    Model,
    TrackingTask,
    follow_motion,
)
from expdesign.configuration import ComputationError
from expdesign.configuration.experiment import FeedforwardSection
from tests.estimation.cases import ROBOT


def test_the_feed_forward_under_which_the_machine_is_lost_is_named():
    count, step, endless = 100, 0.005, np.full(6, np.inf)
    machine = ForwardDynamics(Model(ROBOT, ROBOT.parameters), width=1e-3)
    masses = np.diag(machine.mass_matrix(ROBOT.home))
    law = Controller.of(FeedforwardSection(), masses, step, (-endless, endless))
    lengths = ROBOT.inverse_kinematics(ROBOT.home[None])
    still, ones = np.zeros((count, 6)), np.ones((count, 6))
    weight = ROBOT.actuator_forces(ROBOT.home[None], still[:1], still[:1])
    given = {"none": still, "gravity": weight * ones, "identified": 1e5 * ones}
    task = TrackingTask(lengths * ones, still, 0.0, ones)
    start = np.concatenate([ROBOT.home, np.zeros(6)])
    with pytest.raises(ComputationError) as caught:
        follow_motion(machine, law, task, given, start, np.zeros((3, 6)), 5)
    assert [case for case in given if case in caught.value.message] == ["identified"]
