"""One clause per effect: what is different about the robot, for a reader who has never seen the effect's name.

``{t}`` is the target, ``{s}``, ``{is}`` and ``{has}`` agree with it, ``{p}`` is the parameter p with unit and
interval, ``{p%}`` the same in per cent. An effect without a clause (a user's own) is written by its name.
"""

from __future__ import annotations

from typing import Final

CLAUSES: Final = {
    "clock_offset": "the measured channels are stamped {seconds} late",
    "clock_skew": "the recorder's clock runs {rate%} fast",
    "command_delay": "{t} act{s} on commands {seconds} later than in the simulator",
    "dropped_commands": "{probability%} of the commands to {t} are lost",
    "command_lag": "the commands to {t} pass a lag of {time_constant}",
    "rate_limit": "the set point of {t} moves no faster than {velocity}",
    "command_deadband": "{t} ignore{s} changes of the set point below {width}[, looked at every {period}]",
    "command_quantization": "the set point of {t} is rounded to steps of {step}[ every {period}]",
    "servo_stiffness": "the position gain of {t} is {factor} times the nominal one",
    "servo_damping": "the servo of {t} has {damping} of damping that the simulator lacks",
    "force_limit": "the force of {t} saturates at {limit}",
    "torque_constant": "{t} deliver{s} {factor} times the commanded force",
    "motor_cogging": "{t} {has} a cogging force of {amplitude} with a period of {period}",
    "payload": "{t} carries {mass} that the simulator lacks",
    "gravity_tilt": "the base or the table is tilted about the grasp axis by {angle}",
    "velocity_limit": "{t} move{s} no faster than {velocity}",
    "coulomb_friction": "{t} {has} {force} of Coulomb friction that the simulator lacks",
    "viscous_friction": "{t} {has} {damping} of viscous friction that the simulator lacks",
    "stribeck_friction": "{t} {has} {static} of breakaway friction, gone above {velocity}, that the simulator lacks",
    "load_dependent_friction": "{t} {has} friction of {coefficient} times the transmitted force",
    "asymmetric_friction": "the dry friction of {t} is larger by {force} in the positive direction",
    "backlash": "{t} {has} {width} of play that the simulator lacks",
    "joint_elasticity": "{t} {is} driven through a spring of {stiffness}",
    "armature": "{t} {has} {mass} of reflected inertia that the simulator lacks",
    "coupling_error": "{ratio%} of the neighbouring joint's motion appears on {t}",
    "contact_stiffness": "the contact of pad and object is {factor} times as stiff as in the simulator",
    "contact_inertia": "the contact of pad and object has {factor} times the simulator's virtual mass",
    "contact_damping": "the contact of pad and object is {factor} times as damped as in the simulator",
    "contact_friction": "the sliding friction of pad and object is {factor} times the simulator's",
    "object_size": "the object is larger by {radius} on each side than was said",
    "object_offset": "the object stands {distance} nearer to the left finger than was said",
    "object_mass": "the object has {factor} times the mass that was said",
    "pad_creep": "{fraction%} of the force on {t} fades under load with a time constant of {time_constant}",
    "encoder_bias": "the position readings of {t} are off by {offset}",
    "encoder_scale": "the position readings of {t} are {factor} times the true ones",
    "encoder_quantization": "the position readings of {t} are rounded to steps of {step}",
    "velocity_filter": "the reported velocity of {t} passes a low-pass of {time_constant}",
    "force_bias": "the readings of {t} are off by {offset}",
    "force_gain": "the gain of {t} is {factor} times the nominal one",
    "force_nonlinearity": "the curve of {t} bends by {quadratic}",
    "force_drift": "the zero of {t} drifts by {rate}",
    "force_lag": "the readings of {t} pass a lag of {time_constant}",
    "force_delay": "the readings of {t} come {seconds} late",
    "force_hysteresis": "loading and unloading of {t} differ by {width}",
    "force_crosstalk": "{ratio%} of the other finger's force appears in the readings of {t}",
    "force_saturation": "the readings of {t} go no higher than {limit}",
    "force_dead_zone": "{t} read{s} zero below {width}, and less by that much above",
    "force_quantization": "the readings of {t} are rounded to steps of {step}",
    "force_noise": "the noise of {t} is {factor} times the nominal one",
    "force_dropout": "{probability%} of the readings of {t} are missed",
}

#: The same where the first parameter is negative; it is then written without its sign.
LESS: Final = {
    "clock_offset": "the measured channels are stamped {seconds} early",
    "clock_skew": "the recorder's clock runs {rate%} slow",
    "servo_damping": "the servo of {t} has {damping} less damping than the simulator's",
    "payload": "{t} carries {mass} less than in the simulator",
    "coulomb_friction": "{t} {has} {force} less Coulomb friction than the simulator",
    "viscous_friction": "{t} {has} {damping} less viscous friction than the simulator",
    "asymmetric_friction": "the dry friction of {t} is larger by {force} in the negative direction",
    "armature": "{t} {has} {mass} less reflected inertia than the simulator",
    "object_size": "the object is smaller by {radius} on each side than was said",
    "object_offset": "the object stands {distance} nearer to the right finger than was said",
}
