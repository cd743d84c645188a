"""Refused inputs: a table for the sections of a robot file, and one for those of a run file.

A row has the section in YAML, the key of the problem, and a part of its message. Further lines of a
row are indented.
"""

import pytest
import yaml

ROBOT = """
base_joints: [[1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]] => base_joints => there are
    5 joints where 6 are needed
base_joints: [[1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 5 kg, 0]] =>
    base_joints[6][2] => is a mass, not a length
alpha_axes: [[1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 0]] => alpha_axes[6]
    => the vector is zero
platform_joint_axes: [[1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 0]] =>
    platform_joint_axes[6] => the vector is zero
home: [5 deg, 0, -0.654, 0, 0, 0] => home[1] => is an angle, not a length
home: [0, 0, -0.654, 5 mm, 0, 0] => home[4] => is a length, not an angle
base_joints: {radius: 0, half_angle: 1 deg, pairs: "1-2"} => base_joints.radius => 0 is not
    positive
base_joints: {radius: 1, half_angle: 60 deg, pairs: "1-2"} => base_joints.half_angle =>
    half-angle
base_joints: {radius: 1, half_angle: 1 deg, pairs: "3-4"} => base_joints.pairs => is not a choice
base_joints: {radius: 1, half_angle: 1 deg, pairs: "1-2", half_angel: 1} =>
    base_joints.half_angel => unknown key
base_joints: {radius: 1} => base_joints.half_angle => missing
drive: screw => drive
drive: {} => drive
drive: {screw: {lead: 5 mm, inertia: 6.3e-05}, gear: {lead: 1}} => drive
drive: {screw: null} => drive
drive: {belt: {lead: 1}} => drive.belt
drive: {screw: {inertia: 1}} => drive.screw.lead
drive: {screw: {lead: 0}} => drive.screw.lead
drive: {screw: {lead: 5 mm, inertia: -1}} => drive.screw.inertia
drive: {screw: {lead: 5 mm, thread: both}} => drive.screw.thread
drive: {gear: {lead: 5 mm, thread: left}} => drive.gear.thread
bodies: {} => bodies
bodies: {table: {mass: 1.3, centre: [0, 0, 0.106], inertia: [0.0092, 0.0088, 0.0146]}} =>
    bodies.table
bodies: {platform: {centre: [0, 0, 0]}} => bodies.platform[1].mass
bodies: {platform: {mass: 0, centre: [0, 0, 0.106], inertia: [0.0092, 0.0088, 0.0146]}} =>
    bodies.platform[1].mass
bodies: {platform: {mass: 1.3, centre: [0, 0, 0.106], inertia: [1, 1, 3]}} =>
    bodies.platform[1].inertia
bodies: {platform: {mass: 1, centre: [1, 0, 0], inertia: [0.0001, 0.0001, 0.001]}} =>
    bodies.platform[1].inertia
bodies: {platform: {mass: 1.3, centre: [0, 0, 0.106], inertia: [1, 1]}} =>
    bodies.platform[1].inertia
bodies: {platform: {mass: 1.3, centre: [0, 0, 0.106], inertia: [1, 1, 1, 2, 0, 0]}} =>
    bodies.platform[1].inertia
bodies: {platform: {mass: 1.3, centre: [0, 0, 0.106], inertia: [1 kg, 1 kg, 1 kg]}} =>
    bodies.platform[1].inertia[1]
bodies: {platform: {mass: 1.3, centre: [0, 0, 0.106], inertia: [0.0092, 0.0088, 0.0146], about:
    corner}} => bodies.platform[1].about
bodies: {platform: [{mass: 1.3, centre: [0, 0, 0.106], inertia: [0.0092, 0.0088, 0.0146]}, {mass:
    1.3, centre: [0, 0], inertia: [0.0092, 0.0088, 0.0146]}]} => bodies.platform[2].centre
noise: {force_std: [1.0, 2.0, 3.0, 4.0, 5.0]} => noise.force_std
noise: {force_std: [1, 2, 3, 4, 5, -6]} => noise.force_std[6]
noise: {force_std: [1, 2, 3, 4, 5, 0]} => noise.force_std[6]
noise: {force_std: [1, 2, 3, 4, 5, 6 mm]} => noise.force_std[6]
noise: {force_std: 5} => noise.force_std
noise: {length_covariance: [[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0,
    0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]]} => noise.length_covariance
noise: {length_covariance: [[1, 1, 1, 1, 1], [1, 1, 1, 1, 1], [1, 1, 1, 1, 1], [1, 1, 1, 1, 1],
    [1, 1, 1, 1, 1], [1, 1, 1, 1, 1]]} => noise.length_covariance[1]
noise: {forces_std: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]} => noise.forces_std
noise: {force_covariance: [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0, 0,
    1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]} => noise.force_covariance => the entry
    [3][3] is 0
noise: {force_std: [1.0e+200, 1.0e+200, 1.0e+200, 1.0e+200, 1.0e+200, 1.0e+200]} =>
    noise.force_std => too large or too small
noise: {force_std: [1.0e-200, 1.0e-200, 1.0e-200, 1.0e-200, 1.0e-200, 1.0e-200]} =>
    noise.force_std => too large or too small
tolerances: {base_joints: 3 deg} => tolerances.base_joints => an angle, not a length
tolerances: {base_joints: -0.001} => tolerances.base_joints => negative
tolerances: {base_joints: [0.001, 0.001, 0.001, 0.001, 0.001]} => tolerances.base_joints => 5
    joints where 6
tolerances: {base_joints: [[0.001, 0], [0.001, 0], [0.001, 0], [0.001, 0], [0.001, 0], [0.001,
    0]]} => tolerances.base_joints[1] => 2 coordinates where 3
tolerances: {base_joints: [[0, 0, -1], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]} =>
    tolerances.base_joints[1][3] => negative
tolerances: {force_constant: 2 %} => tolerances.force_constant => not a mapping
tolerances: {force_constant: {common: 2 mm}} => tolerances.force_constant.common => not a share
tolerances: {force_constant: {comon: 0.1}} => tolerances.force_constant.comon => unknown key
tolerances: {clock: 20 ppb} => tolerances.clock => not a share
tolerances: {delay: [0.001, 0.001]} => tolerances.delay => not a duration
tolerances: {terms: {friction: {}}} => tolerances.terms.friction => not a term
tolerances: {terms: {struts: {pitch: 0.1}}} => tolerances.terms.struts.pitch => no constant
    'pitch'
tolerances: {base_joints: 2 m} => tolerances.base_joints => 0.45 m
tolerances: {platform_joints: [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0,
    0.2]]} => tolerances.platform_joints => 0.2 m
tolerances: {strut_length: 1 m} => tolerances.strut_length => 1 m
tolerances: {terms: {force_offset: {}}} => tolerances.terms.force_offset => has no term
    force_offset
tolerances: {terms: {load_frictoin: 1 %}} => tolerances.terms.load_frictoin => not a term
tolerances: {terms: {load_friction: -1}} => tolerances.terms.load_friction => is negative
tolerances: {terms: {passive_friction: 1}} => tolerances.terms.passive_friction => estimated already
tolerances: {terms: {actuator_friction: 1}} => tolerances.terms.actuator_friction => different
    units
tolerances: {terms: {stribeck: 2 N}} => tolerances.terms.stribeck => stribeck.velocity is missing
tolerances: {terms: {stribeck: {std: 2 N, velocity: 0}}} => tolerances.terms.stribeck => not
    positive
tolerances: {terms: {cogging_second: 1 N}} => tolerances.terms.cogging_second => takes the
    constants of 'cogging'
"""

RUN = """
trajectory: {harmonics: 0} => trajectory.harmonics => 0 is out of range
trajectory: {harmonics: -3} => trajectory.harmonics => -3 is out of range
trajectory: {harmonics: 2.5} => trajectory.harmonics => 2.5 is not a whole number
trajectory: {harmonics: true} => trajectory.harmonics => True is not a whole number
trajectory: {harmonics: "5"} => trajectory.harmonics => '5' is not a whole number
trajectory: {harmonics: 1000000000000000000000000000000} => trajectory.harmonics => is out of
    range
trajectory: {frequency: [0.6, 0.1]} => trajectory.frequency => min 0.6 is above max 0.1
trajectory: {frequency: [0, 0.1]} => trajectory.frequency[1] => 0 is not positive
trajectory: {frequency: [0.1]} => trajectory.frequency => there are 1 values
trajectory: {frequency: 0.1} => trajectory.frequency => 0.1 is not a list
trajectory: {frequency: [0.1, 0.6 s]} => trajectory.frequency[2] => is a duration
trajectory: {frequency: [.nan, 1]} => trajectory.frequency[1] => nan is not a finite
trajectory: {samples: 21} => trajectory.samples => 21 samples are too few for 5 harmonics
trajectory: {controller_period: 2 s} => trajectory.controller_period => controller period of 2 s
    is too long
trajectory: {controller_period: 0} => trajectory.controller_period => 0 is not positive
trajectory: 5 => trajectory => 5 is not a mapping
trajectory: [1] => trajectory => a list of 1 is not a mapping
design: {prior: ""} => design.prior => the text is empty
design: {prior: [palida, ""]} => design.prior[2] => the text is empty
design: {criterion: D} => design.criterion => 'D' is not a choice
design: {criterion: [d]} => design.criterion => a list of 1 is not a choice
design: {search: hoping} => design.search => 'hoping' is not a choice
design: {starts: 0} => design.starts => 0 is out of range
design: {seed: -1} => design.seed => -1 is out of range
design: {hops: -1} => design.hops => -1 is out of range
design: {parameters: []} => design.parameters => the list has 0 parameters
design: {parameters: p1} => design.parameters => 'p1' is not a list
design: {parameters: [p1, p1]} => design.parameters => 'p1' is listed twice
design: {parameters: [p11]} => design.parameters[1] => 'p11' is not a parameter
design: {smoothing: [0.1, 0.4]} => design.smoothing => the widths do not fall
design: {smoothing: [0.1, 0]} => design.smoothing[2] => 0 is not positive
design: {smoothing: []} => design.smoothing => the list has 0 widths
design: {max_iterations: 0} => design.max_iterations => 0 is out of range
design: {max_seconds: 5 kg} => design.max_seconds => is a mass
experiment: {periods: 0} => experiment.periods => out of range
experiment: {sampling: 1 ms} => experiment.sampling => is a duration
experiment: {drift: -1 mm} => experiment.drift => -0.001 is negative
experiment: {cogging: {amplitude: 1}} => experiment.cogging.pitch => 'pitch' is missing
experiment: {cogging: {amplitude: [1, 2], pitch: 1}} => experiment.cogging.amplitude => there are
    2 values where 6 are needed
experiment: {outliers: {share: 1}} => experiment.outliers.share => out of range
experiment: {tracking_error: {harmonics: [15, 6]}} => experiment.tracking_error.harmonics => min
    15 is above max 6
experiment: {hum: {amplitude: 5 mm}} => experiment.hum.amplitude => a length, not a force
experiment: {hum: {amplitude: -5}} => experiment.hum.amplitude => -5 is negative
experiment: {hum: {amplitude: 5, phase: random}} => experiment.hum.phase => 'random' is not an
    angle
experiment: {compliance: 1 N/um} => experiment.compliance => the wrong unit
experiment: {compliance: [0, 0, 0, 0, 0, 1 m]} => experiment.compliance[6] => a length, not a
    compliance
experiment: {delay: 1000 s} => experiment.delay => longer than any period
experiment: {delay: -11 s} => experiment.delay => longer than any period
data: {columns: {q7: x}} => data.columns.q7 => 'q7' is not a channel
data: {columns: {q1: 5}} => data.columns.q1 => 5 is not a text
data: {columns: {q1: x, q2: x}} => data.columns => 'x' is both q1 and q2
data: {units: {q: kg}} => data.units => 'kg' is not a unit for q
data: {units: {q: nonsense}} => data.units => 'nonsense' is not a unit for q
data: {units: {Q: A}} => data.units.Q => no force constants are given
data: {units: {q: counts}} => data.units => q is a count, but neither counts_per_metre nor
    counts_per_revolution are given
data: {units: {q: rev}} => data.units.q => states no lead of the drives
data: {counts_per_metre: 1.0, counts_per_revolution: 1.0} => data.counts_per_revolution => both
export: [{format: csv, units: deg}] => export[1] => lengths in deg cannot be computed
export: [{format: mat, space: pose, units: rev}] => export[1].units => is a unit of motors
data: {delimiter: ";;"} => data.delimiter => is not one character
data: {decimal: ","} => data.decimal => both delimiter and decimal mark
data: {time_tolerance: 0.5} => data.time_tolerance => out of range
data: {time: jitter} => data.time => is not a choice
estimate: {estimators: []} => estimate.estimators => the list has 0 estimators
estimate: {estimators: [ls, ls]} => estimate.estimators => 'ls' is listed twice
estimate: {estimators: [lm]} => estimate.estimators[1] => 'lm' is not a choice
estimate: {harmonics: many} => estimate.harmonics => 'many' is not a whole number
estimate: {harmonics: 0} => estimate.harmonics => 0 is out of range
estimate: {fixed: p1} => estimate.fixed => 'p1' is not a mapping
estimate: {fixed: [q1]} => estimate.fixed => 'q1' is not a parameter
estimate: {fixed: {p1: 5 m}} => estimate.fixed.p1 => '5 m' is a length
estimate: {prior: {p1: {value: 1}}} => estimate.prior.p1 => does not state a prior
estimate: {prior: {p1: {std: 0}}} => estimate.prior.p1 => 0 is not positive
estimate: {bounds: {p1: [2, 1]}} => estimate.bounds.p1 => min 2 is not below max 1
estimate: {bounds: {p1: 5}} => estimate.bounds.p1 => 5 is not a pair
montecarlo: {repetitions: 0} => montecarlo.repetitions => 0 is out of range
report: {figures: [gif]} => report.figures[1] => 'gif' is not a choice
validate: [{motion: square}] => validate[1].motion => is not a choice
validate: [{mirror: xz}] => validate[1].motion => is missing
validate: [{motion: file}] => validate[1].file => names no file
validate: [{motion: spline}] => validate[1].poses => has no poses
validate: [{motion: circle, normal: [0, 0, 0]}] => validate[1].normal => zero
validate: [{motion: circle, tolerance: 300 %}] => validate[1].tolerance => more than the whole
    range
validate: {motion: circle} => validate => a mapping is not a list
export: [xps] => export[1] => 'xps' is not a choice
export: csv => export => 'csv' is not a list
workers: 0 => workers => 0 is out of range
workers: 1.0 => workers => 1.0 is not a whole number
scheduler: localhost => scheduler => not the address of a scheduler
{workers: 2, scheduler: "tcp://a:1"} => scheduler => both given
limits: 5 => limits => 5 is not a mapping
noise: {std: 5} => noise.std => unknown key 'std'
robot: 5 => robot => 5 is not a text
robot: "" => robot => the text is empty
export: [{format: xps}] => export[1].format => 'xps' is not a choice
export: [csv, csv] => export => 'csv' is listed twice
export: [{format: csv, digits: 3}] => export[1].digits => csv has no option 'digits'
export: [{format: xps-pvt, unit: mm}] => export[1].unit => unknown key 'unit'
export: [{format: xps-pvt, digits: -1}] => export[1].digits => -1 is out of range
export: [{format: xps-pvt, segment: 0}] => export[1].segment => 0 is not positive
export: [{format: xps-pvt, sign: 2}] => export[1].sign => 2 is not a sign
export: [{format: xps-pvt, order: [1, 1, 2, 3, 4, 5]}] => export[1].order => [1, 1, 2, 3, 4, 5]
    is not an order of the 6 struts
export: [csv, {format: xps-pvt, offset: [0.6, 0.6]}] => export[2].offset => there are 2 values
    where 6 are needed
export: [{format: xps-pvt, space: pose, offset: home}] => export[1].offset => 'offset' is about
    actuators, the table holds poses
export: [{format: xps-pvt, units: mm, counts_per_metre: 1000000.0}] => export[1].units => units
    and counts_per_metre are both given
sweep: {} => sweep => names no key
sweep: {design.seed: 3} => sweep.design.seed => not a list
sweep: {design.seed: []} => sweep.design.seed => 0 values
sweep: {design.seed: [1, 2, 1]} => sweep.design.seed => twice
sweep: {design.criterion: [d, q]} => sweep.design.criterion[2] => 'q'
sweep: {limits.strut_speed: [1, 2 N]} => sweep.limits.strut_speed[2] => a force
sweep: {limits.tilt.scale: [0.5, 0]} => sweep.limits.tilt.scale => not positive
sweep: {limits.platform_joint_angle.scale: [2]} =>
    sweep.limits.platform_joint_angle.scale[1]
sweep: {limits.position: [{z: [-0.7, -0.6]}], limits.position.z: [[-0.7, -0.6]]} =>
    sweep.limits.position.z => limits.position
sweep: {limits.strut_speed: [1], limits.strut_speed.scale: [2]} => sweep.limits.strut_speed.scale
    => limits.strut_speed
limits: {strut_length: [0.9, 0.4]} => limits.strut_length => min 0.9 is not below max 0.4
limits: {strut_length: [0.4, 0.4]} => limits.strut_length => min 0.4 is not below max 0.4
limits: {strut_length: [[0.9 m, 0.4], [0.4, 0.9], [0.4, 0.9], [0.4, 0.9], [0.4, 0.9], [0.4,
    0.9]]} => limits.strut_length => strut 1: min 0.9
limits: {strut_length: 0.9} => limits.strut_length => 0.9 is not a pair
limits: {strut_length: [0.1, 0.2, 0.3]} => limits.strut_length => there are 3 entries
limits: {strut_length: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1]} => limits.strut_length => strut 1: 0.1 is
    not a pair
limits: {strut_length: [[0.1, 0.2], [0.1, 0.2], [0.1, 0.2], [0.1, 0.2], [0.1, 0.2]]} =>
    limits.strut_length => there are 5 entries
limits: {strut_length: [[0.1, 0.2], [0.1, 0.2]]} => limits.strut_length => there are 2 entries
limits: {strut_length: []} => limits.strut_length => there are 0 entries
limits: {strut_length: {min: 1, max: 2}} => limits.strut_length => a mapping is not a pair
limits: {strut_length: [0.4, 5 kg]} => limits.strut_length => is a mass, not a length
limits: {strut_length: [0.4, .inf]} => limits.strut_length => inf is not a finite number
limits: {strut_length: [0.4, .nan]} => limits.strut_length => nan is not a finite number
limits: {strut_length: [0.4, null]} => limits.strut_length => nothing is not a length
limits: {strut_length: null} => limits.strut_length => nothing is not a pair
limits: {strut_speed: -2} => limits.strut_speed => the bound -2 is not positive
limits: {strut_speed: 0} => limits.strut_speed => the bound 0 is not positive
limits: {strut_speed: true} => limits.strut_speed => True is not a speed
limits: {strut_speed: 2 m} => limits.strut_speed => is a length, not a speed
limits: {strut_speed: [1, 2, 3, 4, 5, x]} => limits.strut_speed => strut 6: 'x' is not a speed
limits: {tilt: [0, 1]} => limits.tilt => a list of 2 does not fit
limits: {tilt: 200 deg} => limits.tilt => larger than any angle between directions
limits: {tilt: -0.1} => limits.tilt => not positive
limits: {jacobian_condition: 10 m} => limits.jacobian_condition => is a length, not a number
limits: {jacobian_condition: .inf} => limits.jacobian_condition => not a finite number
limits: {strut_clearance: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1,
    0.1]} => limits.strut_clearance => there are 15 entries
limits: {position: [-1, 1]} => limits.position => bounds no component
limits: {position: {}} => limits.position => bounds no component
limits: {position: {x: 1}} => limits.position => x: 1 is not a pair
limits: {position: {x: [1, -1]}} => limits.position => x: min 1 is not below max -1
limits: {beta: [-100 deg, 0 deg]} => limits.beta => cannot be bounded so widely
limits: {characteristic_length: 0} => limits.characteristic_length => 0 is not positive
limits: {characteristic_length: 1 s} => limits.characteristic_length => is a duration, not a
    length
limits: {reserve: 0.5} => limits.reserve
limits: {reserve: 50 %} => limits.reserve
limits: {reserve: -0.01} => limits.reserve
limits: {reserve: 3 N} => limits.reserve
limits: {reserve: null} => limits.reserve
limits: {reserve: true} => limits.reserve
limits: {reserve: [0.1]} => limits.reserve
limits: {reserve: .nan} => limits.reserve
limits: {reserve: "3"} => limits.reserve
limits: {reserve: {tilt: 0.7}} => limits.reserve.tilt
limits: {reserve: {strut_sped: 3 %}} => limits.reserve.strut_sped => is not a limit
"""


def _rows(table):
    lines = table.strip().replace("\n    ", " ").splitlines()
    return [pytest.param(*f"{line} => ".split(" => ")[:3], id=line) for line in lines]


@pytest.mark.parametrize(("given", "key", "says"), _rows(ROBOT))
def test_a_robot_file_is_refused(run_mapping, problems_of, given, key, says):
    run_mapping["robot"] |= yaml.safe_load(given)
    found = {problem.key.removeprefix("robot."): problem for problem in problems_of(run_mapping)}
    assert key in found
    assert says in found[key].message
    assert found[key].allowed or "is missing" in found[key].message


@pytest.mark.parametrize(("given", "key", "says"), _rows(RUN))
def test_a_run_file_is_refused(run_mapping, the_problem, given, key, says):
    problem = the_problem(run_mapping | yaml.safe_load(given))
    assert problem.key == key
    assert says in problem.message
