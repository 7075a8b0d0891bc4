"""Models of MuJoCo that other engines step too: a ball over a plate, and a leg that hops."""

from __future__ import annotations

BALL = """<mujoco><option timestep="0.001" integrator="{integrator}"/><worldbody>
  <geom name="plate" type="plane" size="1 1 .1" pos="0 0 {height}"/>
  <body name="ball" pos="0 0 {ball}"><freejoint/><geom name="ball" size=".05" mass="1"/></body></worldbody>
  <contact>{pairs}</contact></mujoco>"""
PAIR = '<pair geom1="ball" geom2="plate" {}/>'
SPRING = PAIR.format('solref="-90000 -20" friction=".3 .3 .005 .0001 .0001"')
HOPPER = """<mujoco><option timestep=".001"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <body name="torso" pos="0 0 .62"><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".05" mass="3"/>
    <body name="thigh"><joint name="hip" axis="0 1 0" damping="1" armature=".01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".04" mass="1"/>
      <body name="shin" pos="0 0 -.25"><joint name="knee" axis="0 1 0" damping="1" armature=".01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass=".5"/>
        <body name="foot" pos="0 0 -.25"><geom name="foot" size=".05" mass=".3" solref="-20000 -10"/></body>
  </body></body></body></worldbody>
  <actuator><position joint="hip" kp="80"/><position joint="knee" kp="80"/></actuator>
  <keyframe><key name="bent" qpos=".2 0 .4 -.8" ctrl=".4 -.8"/></keyframe></mujoco>"""


def ball(integrator: str = "Euler", pairs: str = SPRING, height: float = 0.0) -> str:
    """A ball of 50 mm, 10 mm above a plate at `height`, m, with `pairs` as its contact pairs."""
    return BALL.format(integrator=integrator, pairs=pairs, height=height, ball=height + 0.06)
