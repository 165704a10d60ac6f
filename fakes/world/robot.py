"""The robot of the world: a two-wheel drive on casters, and the MuJoCo model around it.

Wheels are spheres: a cylinder wheel stalls for ever at an edge of 3 cm. They turn as wheels do,
about an axle. The robot's body frame is the frame of its MuJoCo body: x forward, y left, z up,
origin on the ground under the middle of the axle. The casters stand on stiff springs, so that the
body nods when it speeds up, brakes or rolls over something; at rest it is level.
"""

from typing import NamedTuple

from fakes.scenes.scene import Scene
from fakes.scenes.solids import mjcf_from_solids

WHEEL_RADIUS_M = 0.15
TRACK_WIDTH_M = 0.50
MAX_SPEED_MPS = 1.0  # at the rim, full power
COUNTS_PER_TURN = 2000  # 500 pulses, quadrature, encoder on the wheel's own axle
LENS_BODY_M = (0.25, 0.0, 1.08)
AHRS_BODY_M = (0.0, 0.0, 0.30)
CASTER_BODY_M = (0.40, 0.16, 0.12)  # the left one
CASTER_RADIUS_M = 0.12
LENS_TILT_DEG = 7.5  # looking down
CASTER_LOAD_N = 9.81 * ((36 * 0.13 + 2 * 0.5 * 0.40) / 0.40 / 2 - 0.5)  # on each spring, at rest
STEP_S, STEPS = 0.0025, 2  # of physics, as stiff contacts want it; so many between two rows
HALF_LENGTH_M, HALF_WIDTH_M = 0.52, 0.30  # from the axle's middle: what must clear things


class Mount(NamedTuple):
    """Where a scanner's lens sits on the body, and how much it looks down."""

    x_m: float
    y_m: float
    z_m: float
    tilt_deg: float


MOUNT = Mount(*LENS_BODY_M, LENS_TILT_DEG)
MOST_M = 5.0  # that a lens is away from the body's origin


def mount_from(name: str, x_m: float, y_m: float, z_m: float, tilt_deg: float) -> Mount:
    """Of numbers that somebody gave; ValueError, with their name: no lens sits so."""
    place_m, is_above = (x_m, y_m, z_m), z_m > 0
    if not (is_above and all(abs(part) <= MOST_M for part in place_m) and abs(tilt_deg) <= 90):
        given = f"{x_m:g} {y_m:g} {z_m:g} {tilt_deg:g}"
        raise ValueError(
            f"{name}: must be x, y, z of up to {MOST_M:g} m, z above 0, and a tilt of -90 to 90 "
            f"degrees, is {given}"
        )
    return Mount(x_m, y_m, z_m, tilt_deg)


MODEL = """
<mujoco model="{name}">
  <compiler angle="degree" autolimits="true"/>
  <option timestep="{step_s}" integrator="implicitfast" cone="elliptic" impratio="20"
          gravity="0 0 -9.81" iterations="30" tolerance="1e-9"/>
  <default>
    <default class="scene">
      <geom group="0" contype="1" conaffinity="2" friction="1 0 0" condim="3"
            solref="0.006 1" solimp="0.97 0.99 0.001"/>
    </default>
    <default class="robot">
      <geom group="1" contype="0" conaffinity="0" mass="0"/>
      <default class="wheel">
        <geom type="sphere" size="{radius}" contype="2" conaffinity="1" mass="1.5"
              friction="1 0 0" condim="3" solref="0.006 1" solimp="0.97 0.99 0.001"/>
        <joint type="hinge" axis="0 1 0" armature="0.02" damping="0.02"/>
      </default>
      <default class="caster">
        <geom type="sphere" size="0.12" contype="2" conaffinity="1" mass="0.5"
              friction="0 0 0" condim="1" priority="1"
              solref="0.006 1" solimp="0.97 0.99 0.001"/>
        <joint type="slide" axis="0 0 1" stiffness="6000" damping="220" springref="{sag_m}"
               range="-0.015 0.015"/>
      </default>
    </default>
  </default>
  <asset>
{assets}
  </asset>
  <worldbody>
{geoms}
    <body name="robot" pos="0 0 0">
      <freejoint/>
      <inertial pos="0.13 0 0.30" mass="36" diaginertia="1.6 2.6 2.4"/>
      <geom class="robot" name="chassis" type="box" pos="0.16 0 0.24" size="0.34 0.18 0.10"
            contype="2" conaffinity="1"/>
      <geom class="robot" name="mast" type="cylinder" pos="0.20 0 0.68" size="0.03 0.35"/>
      <site name="ahrs" pos="0 0 0.30"/>
      <body name="left" pos="0 {half_track} {radius}">
        <joint class="wheel" name="left"/>
        <geom class="wheel" name="left"/>
      </body>
      <body name="right" pos="0 -{half_track} {radius}">
        <joint class="wheel" name="right"/>
        <geom class="wheel" name="right"/>
      </body>
      <body name="left caster" pos="0.40 0.16 0.12">
        <joint class="caster"/>
        <geom class="caster"/>
      </body>
      <body name="right caster" pos="0.40 -0.16 0.12">
        <joint class="caster"/>
        <geom class="caster"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity joint="left" kv="20" forcerange="-25 25"/>
    <velocity joint="right" kv="20" forcerange="-25 25"/>
  </actuator>
  <sensor>
    <gyro site="ahrs"/>
    <accelerometer site="ahrs"/>
  </sensor>
</mujoco>
"""


def mjcf(scene: Scene) -> str:
    """The MuJoCo model, as XML, of the robot at the origin of a scene."""
    assets, geoms = mjcf_from_solids(scene.firm)
    return MODEL.format(
        name=scene.name,
        step_s=STEP_S,
        radius=WHEEL_RADIUS_M,
        sag_m=-CASTER_LOAD_N / 6000,
        half_track=TRACK_WIDTH_M / 2,
        assets=assets,
        geoms=geoms,
    )
