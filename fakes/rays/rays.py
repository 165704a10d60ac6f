"""What the scanner's beams meet in a scene, from wherever the lens is.

Each beam leaves from the pose of its own instant, and meets what stands, who walks, glass, black
and soft things in closed formulas. A wide beam is a bundle of rays. The robot itself is in nobody's
way.
"""

import math
from collections.abc import Callable

import numpy as np

from fakes.rays import light as beam_light
from fakes.rays.beam_kernels import FAR_M, Beams, aims_of, echoes_of_beams
from fakes.rays.crossing_kernels import ways_through_box
from fakes.rays.kernels import F64, Passers
from fakes.rays.sight import Met, met_from
from fakes.rays.targets import targets_from
from fakes.scenes.movers import Mover, Part
from fakes.scenes.scene import Scene
from fakes.scenes.solids import Shape, Solid
from fakes.world import robot
from fakes.world.crowd import Crowd
from fakes.world.error_models import NONE, ErrorModels
from fakes.world.rotations import rotation_y

GLASS_COS = math.cos(math.radians(10.0))  # glass returns a beam that is nearer to a right angle
SECOND_SHARE = 0.6  # of the beams that end on a stalk and return from what is behind it, too
KEYS = 2**62 - 1  # of what is left to chance in a sweep
KNOT_S = 0.0025  # between the instants at which movers are asked where they are

Poses = Callable[[F64], tuple[F64, F64]]  # instants (m,) to t_map_body (m, 3), R_map_body (m, 3, 3)


class Rays:
    """Beams through a scene. The same beams at the same instants meet the same, whenever asked.

    Args:
        seed: of what they meet in soft things and in the air.
        errors: of light and air, and how wide beams are.
        crowd: people who are in the way besides the scene's movers.
        mount: of the lens on the body.

    Raises:
        ValueError: glass or a soft thing is no upright box.
    """

    def __init__(
        self,
        scene: Scene,
        seed: int,
        errors: ErrorModels = NONE,
        crowd: Crowd | None = None,
        mount: robot.Mount = robot.MOUNT,
    ) -> None:
        self._lens_body_m = np.array(mount[:3])
        self._R_body_lens = rotation_y(math.radians(mount.tilt_deg))
        returning = [s for s in scene.solids if s.material.kind != "soft"]
        self._soft = [_upright(s) for s in scene.solids if s.material.kind == "soft"]
        for solid in returning:
            if solid.material.kind == "glass":
                _upright(solid)
        self._targets = targets_from(returning)
        self._boxes = [np.array([solid.x, solid.y, solid.z]).T.copy() for solid in self._soft]
        self._errors, self._seed, self._crowd = errors, seed, crowd
        self._pattern = beam_light.pattern_of(errors)
        self._passers = _Passers(scene.movers, crowd)

    @property
    def echoes(self) -> int:
        """How many a beam may have: 2 where something lets light through or beams are wide."""
        errors = self._errors
        two = self._soft or errors.beam_rad or errors.dust_per_m or errors.rain_per_m
        return 2 if two else 1

    def ranges_m(self, poses_at: Poses, times_s: F64, bearings_rad: F64, begin_s: float) -> F64:
        """What beams from the lens meet: metres, NaN where nothing is within 30 m.

        Args:
            poses_at: where the body is at an instant.
            times_s: (n,) instants, in order.
            bearings_rad: (n,) in the scan plane, from straight ahead, counter-clockwise.
            begin_s: the instant at which the movers' time is zero.

        Returns:
            (n,), or (2, n) with the second echoes of a scene that has them; -inf where a beam came
            back dazzled.
        """
        # Of one layout, whoever gives them: the kernels are compiled for that one.
        bodies, turns, bearings = map(np.ascontiguousarray, (*poses_at(times_s), bearings_rad))
        lens, errors = (self._lens_body_m, self._R_body_lens), self._errors
        beams = Beams(bodies, turns, *lens, bearings, self._pattern, errors.beam_rad)
        since_begin_s = times_s - begin_s
        passers = self._passers.between(since_begin_s[0], since_begin_s[-1])
        echoes, azimuths = echoes_of_beams(
            beams, since_begin_s, self._targets, passers, GLASS_COS, errors.mixed_pixels
        )
        begun = round(abs(float(times_s[0])) * 1e6)
        if self._soft:
            random = np.random.default_rng([self._seed, begun, len(times_s)])
            aims = aims_of(beams)
            echoes = self._among_stalks(random, aims[0], aims[1], echoes)
        key = (self._seed << 44) + (begun << 8) & KEYS
        if errors.dust_per_m or errors.rain_per_m:
            beam_light.through_air(key, errors.dust_per_m, errors.rain_per_m, echoes)
        if errors.sunlight_rate:
            sun = (errors.sunlight_rate, errors.sun_azimuth_rad, errors.sun_half_rad)
            beam_light.in_sunlight(key, *sun, azimuths, echoes)
        echoes[echoes > FAR_M] = np.nan
        return echoes if self.echoes == 2 else echoes[0]

    def met(self, poses_at: Poses, t_s: float, rays: tuple[F64, F64], begin_s: float) -> Met:
        """What any rays meet at one instant.

        Args:
            rays: where they begin (n, 3) in the body frame, and their ways (n, 3) of unit length.
            begin_s: the instant at which the movers' time is zero.
        """
        (place,), (turn,) = poses_at(np.array([t_s]))
        begins, ways = place + rays[0] @ turn.T, rays[1] @ turn.T
        passers = self._passers.between(t_s - begin_s, t_s - begin_s)
        return met_from(begins, ways, t_s - begin_s, self._targets, passers, GLASS_COS, FAR_M)

    def _among_stalks(
        self, random: np.random.Generator, begins: F64, ways: F64, behind: F64
    ) -> F64:
        """Echoes (2, n) where rays (3, n) that would go to behind (2, n) cross soft things."""
        n = ways.shape[1]
        echoes, enter_m, leave_m = [*behind], np.empty(n), np.empty(n)
        for (low, high), solid in zip(self._boxes, self._soft, strict=True):
            ways_through_box(begins, ways, low, high, enter_m, leave_m)
            gap_m = 1.0 / solid.material.density_per_m
            stalks_m = enter_m + np.cumsum(random.exponential(gap_m, (2, n)), axis=0)
            echoes += list(np.where(stalks_m < np.minimum(leave_m, behind[0]), stalks_m, np.inf))
        first, second = np.sort(echoes, axis=0)[:2]
        second[random.random(n) >= SECOND_SHARE] = np.inf
        return np.stack([first, second])


class _Passers:
    """All upright parts of movers and walkers, and where they are during a sweep."""

    def __init__(self, movers: tuple[Mover, ...], crowd: Crowd | None) -> None:
        self._crowd = crowd
        self._of_movers = [(mover, part) for mover in movers for part in mover.parts]
        walking = crowd.parts if crowd is not None else ()
        self.parts: tuple[Part, ...] = (*(part for _, part in self._of_movers), *walking)
        stays = [(mover.from_s, mover.until_s) for mover, _ in self._of_movers]
        self._stays_s = np.array([*stays, *[(-math.inf, math.inf)] * len(walking)]).reshape(-1, 2)
        halves_m = [part.half_m or (0.0, 0.0) for part in self.parts]
        self._radii_m = np.array([part.radius_m for part in self.parts], dtype=float)
        self._halves_m = np.array(halves_m, dtype=float).reshape(-1, 2)
        self._spans_m = np.array([part.z for part in self.parts], dtype=float).reshape(-1, 2)

    def between(self, first_s: float, last_s: float) -> Passers:
        """For a sweep from first_s to last_s, seconds since the world's begin."""
        knots = 1 + math.ceil((last_s - first_s) / KNOT_S) if self.parts else 1
        every_s = (last_s - first_s) / (knots - 1) if knots > 1 else 1.0
        knots_s = np.linspace(first_s, last_s, knots)
        middles = [mover.middles_m(part, knots_s)[:, None] for mover, part in self._of_movers]
        if self._crowd is not None:
            middles.append(self._crowd.parts_m(knots_s))
        known = self._radii_m, self._halves_m, self._spans_m, self._stays_s
        none = np.zeros((knots, 0, 2))
        return Passers(first_s, every_s, np.concatenate([none, *middles], axis=1), *known)


def _upright(shape: Shape) -> Solid:
    if not isinstance(shape, Solid) or shape.rise_rad or shape.rise_x_rad:
        raise ValueError("what is glass or soft must be an upright box")
    return shape
