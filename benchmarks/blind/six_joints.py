"""An arm of six joints on position servos, as small industrial arms are: 11 kg, 0.9 m long; the numbers are our own."""

from typing import Final

FILE: Final = "six_joints.xml"
JOINTS: Final = ("turn", "shoulder_lift", "elbow", "wrist_lift", "wrist_turn", "flange_turn")
MJCF: Final = """<mujoco model="six_joints">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <joint type="hinge" range="-2.8 2.8"/>
  </default>
  <worldbody>
    <geom name="foot" type="cylinder" fromto="0 0 0 0 0 0.1" size="0.08" mass="2" contype="0" conaffinity="0"/>
    <body name="shoulder" pos="0 0 0.16">
      <joint name="turn" axis="0 0 1" damping="3" armature="0.25"/>
      <geom type="capsule" fromto="0 0 -0.05 0 0 0.05" size="0.06" mass="2.6" contype="0" conaffinity="0"/>
      <body name="upper_arm" pos="0 0.09 0">
        <joint name="shoulder_lift" axis="0 1 0" damping="3" armature="0.3"/>
        <geom type="capsule" fromto="0 0 0 0.40 0 0" size="0.045" mass="3.6" contype="0" conaffinity="0"/>
        <body name="forearm" pos="0.40 -0.07 0">
          <joint name="elbow" axis="0 1 0" damping="2" armature="0.18"/>
          <geom type="capsule" fromto="0 0 0 0.36 0 0" size="0.038" mass="2.3" contype="0" conaffinity="0"/>
          <body name="wrist" pos="0.36 0 0">
            <joint name="wrist_lift" axis="0 1 0" damping="0.8" armature="0.06"/>
            <geom type="capsule" fromto="0 -0.04 0 0 0.04 0" size="0.036" mass="1.1" contype="0" conaffinity="0"/>
            <body name="hand" pos="0.02 0.08 0">
              <joint name="wrist_turn" axis="0 0 1" damping="0.7" armature="0.05"/>
              <geom type="capsule" fromto="0 0 -0.03 0 0 0.03" size="0.034" mass="0.9" contype="0" conaffinity="0"/>
              <body name="flange" pos="0.06 0 -0.05">
                <joint name="flange_turn" axis="1 0 0" damping="0.5" armature="0.04"/>
                <geom type="box" pos="0.04 0 0" size="0.03 0.05 0.02" mass="0.5" contype="0" conaffinity="0"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="turn" joint="turn" kp="900" kv="60" forcerange="-120 120"/>
    <position name="shoulder_lift" joint="shoulder_lift" kp="900" kv="60" forcerange="-120 120"/>
    <position name="elbow" joint="elbow" kp="600" kv="40" forcerange="-90 90"/>
    <position name="wrist_lift" joint="wrist_lift" kp="200" kv="9" forcerange="-28 28"/>
    <position name="wrist_turn" joint="wrist_turn" kp="150" kv="7" forcerange="-28 28"/>
    <position name="flange_turn" joint="flange_turn" kp="120" kv="5" forcerange="-28 28"/>
  </actuator>
</mujoco>
"""
#: How far joints move from where they start [rad], how fast [rad/s], and how fast speeds change [rad/s²].
REACH, FASTEST, ACCELERATION = 0.6, 1.2, 5.0
