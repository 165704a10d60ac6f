"""The robots of the world: two-wheel drives on casters, and the MuJoCo model around one.

Wheels are spheres: a cylinder wheel stalls for ever at an edge of 3 cm. They turn as wheels do,
about an axle. The robot's body frame is the frame of its MuJoCo body: x forward, y left, z up,
origin on the ground under the middle of the axle. The casters stand on stiff springs, so that the
body nods when it speeds up, brakes or rolls over something; at rest it is level.
"""

from typing import NamedTuple

from fakes.scenes.scene import Scene
from fakes.scenes.solids import mjcf_from_solids

MAX_SPEED_MPS = 1.0  # at the rim, full power
COUNTS_PER_TURN = 2000  # 500 pulses, quadrature, encoder on the wheel's own axle
LENS_BODY_M = (0.25, 0.0, 1.08)
LENS_TILT_DEG = 7.5  # looking down
HALF_LENGTH_M, HALF_WIDTH_M = 0.52, 0.30  # of the usual one, from the axle: must clear things
SPRING_N_M, CASTER_KG = 6000.0, 0.5  # of each caster
STEP_S, STEPS = 0.0025, 2  # of physics, as stiff contacts want it; so many between two rows


class Body(NamedTuple):
    """What a robot is made of; lengths in its own frame."""

    wheel_radius_m: float
    track_width_m: float  # between the wheels' contacts
    caster_x_m: float
    caster_y_m: float  # to either side
    caster_radius_m: float
    mass_kg: float  # without wheels and casters
    mass_at_m: tuple[float, float, float]
    inertia_kgm2: tuple[float, float, float]
    chassis_at_m: tuple[float, float, float]
    chassis_half_m: tuple[float, float, float]
    mast_at_m: tuple[float, float, float]
    mast_half_m: float  # of its height
    ahrs_m: tuple[float, float, float]

    @property
    def sag_m(self) -> float:
        """By which each caster's spring is pressed at rest."""
        on_both_kg = (self.mass_kg * self.mass_at_m[0]) / self.caster_x_m + 2 * CASTER_KG
        return 9.81 * (on_both_kg / 2 - CASTER_KG) / SPRING_N_M


BODY = Body(
    wheel_radius_m=0.15,
    track_width_m=0.50,
    caster_x_m=0.40,
    caster_y_m=0.16,
    caster_radius_m=0.12,
    mass_kg=36.0,
    mass_at_m=(0.13, 0.0, 0.30),
    inertia_kgm2=(1.6, 2.6, 2.4),
    chassis_at_m=(0.16, 0.0, 0.24),
    chassis_half_m=(0.34, 0.18, 0.10),
    mast_at_m=(0.20, 0.0, 0.68),
    mast_half_m=0.35,
    ahrs_m=(0.0, 0.0, 0.30),
)
SMALL = Body(  # as robots/ragno.toml has it: 0.5 m long, 0.4 m wide, 0.6 m high
    wheel_radius_m=0.06,
    track_width_m=0.28,
    caster_x_m=0.18,
    caster_y_m=0.10,
    caster_radius_m=0.05,
    mass_kg=9.0,
    mass_at_m=(0.05, 0.0, 0.14),
    inertia_kgm2=(0.12, 0.22, 0.26),
    chassis_at_m=(0.0, 0.0, 0.16),
    chassis_half_m=(0.25, 0.14, 0.07),
    mast_at_m=(0.20, 0.0, 0.41),
    mast_half_m=0.19,
    ahrs_m=(0.0, 0.0, 0.15),
)
CLEANER = Body(  # as robots/cleaner.toml has it: 0.36 m long, and 0.6 m wide, as its tool is
    wheel_radius_m=0.08,
    track_width_m=0.44,
    caster_x_m=0.14,
    caster_y_m=0.10,
    caster_radius_m=0.04,
    mass_kg=28.0,
    mass_at_m=(0.05, 0.0, 0.16),
    inertia_kgm2=(0.9, 0.6, 1.0),
    chassis_at_m=(0.0, 0.0, 0.17),
    chassis_half_m=(0.18, 0.19, 0.09),
    mast_at_m=(0.0, 0.0, 0.62),
    mast_half_m=0.36,
    ahrs_m=(0.0, 0.0, 0.20),
)
WHEEL_RADIUS_M, TRACK_WIDTH_M = BODY.wheel_radius_m, BODY.track_width_m
CASTER_BODY_M = (BODY.caster_x_m, BODY.caster_y_m, BODY.caster_radius_m)  # the left one
CASTER_RADIUS_M, AHRS_BODY_M = BODY.caster_radius_m, BODY.ahrs_m
SAME_M = 1e-6


def body_with(wheel_radius_m: float, track_width_m: float) -> Body:
    """The robot that has these wheels; the usual one, if none has."""
    for body in (BODY, SMALL, CLEANER):
        wheels_m = body.wheel_radius_m - wheel_radius_m, body.track_width_m - track_width_m
        if max(map(abs, wheels_m)) < SAME_M:
            return body
    return BODY


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
        <geom type="sphere" size="{caster_radius}" contype="2" conaffinity="1" mass="{caster_kg}"
              friction="0 0 0" condim="1" priority="1"
              solref="0.006 1" solimp="0.97 0.99 0.001"/>
        <joint type="slide" axis="0 0 1" stiffness="{spring}" damping="220" springref="{sag_m}"
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
      <inertial pos="{mass_at}" mass="{mass_kg}" diaginertia="{inertia}"/>
      <geom class="robot" name="chassis" type="box" pos="{chassis_at}" size="{chassis_half}"
            contype="2" conaffinity="1"/>
      <geom class="robot" name="mast" type="cylinder" pos="{mast_at}" size="0.03 {mast_half}"/>
      <site name="ahrs" pos="{ahrs}"/>
      <body name="left" pos="0 {half_track} {radius}">
        <joint class="wheel" name="left"/>
        <geom class="wheel" name="left"/>
      </body>
      <body name="right" pos="0 -{half_track} {radius}">
        <joint class="wheel" name="right"/>
        <geom class="wheel" name="right"/>
      </body>
      <body name="left caster" pos="{caster_x} {caster_y} {caster_radius}">
        <joint class="caster"/>
        <geom class="caster"/>
      </body>
      <body name="right caster" pos="{caster_x} -{caster_y} {caster_radius}">
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


def mjcf(scene: Scene, body: Body = BODY) -> str:
    """The MuJoCo model, as XML, of a robot at the origin of a scene."""

    def told(place: tuple[float, ...]) -> str:
        return " ".join(map(str, place))

    assets, geoms = mjcf_from_solids(scene.firm)
    return MODEL.format(
        name=scene.name,
        step_s=STEP_S,
        radius=body.wheel_radius_m,
        sag_m=-body.sag_m,
        half_track=body.track_width_m / 2,
        spring=SPRING_N_M,
        caster_kg=CASTER_KG,
        caster_x=body.caster_x_m,
        caster_y=body.caster_y_m,
        caster_radius=body.caster_radius_m,
        mass_at=told(body.mass_at_m),
        mass_kg=body.mass_kg,
        inertia=told(body.inertia_kgm2),
        chassis_at=told(body.chassis_at_m),
        chassis_half=told(body.chassis_half_m),
        mast_at=told(body.mast_at_m),
        mast_half=body.mast_half_m,
        ahrs=told(body.ahrs_m),
        assets=assets,
        geoms=geoms,
    )
