"""The plane nearest to weighted points, by their sums: no point is kept."""

from jit import kernel

Sums = tuple[float, float, float, float, float, float, float, float, float]
NO_POINTS: Sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def with_point(sums: Sums, u: float, v: float, z: float, w: float) -> Sums:
    """The sums with one more point, of weight w."""
    w0, wu, wv, wz, wuu, wuv, wvv, wzu, wzv = sums
    w0, wu, wv, wz = w0 + w, wu + w * u, wv + w * v, wz + w * z
    wuu, wuv, wvv = wuu + w * u * u, wuv + w * u * v, wvv + w * v * v
    return w0, wu, wv, wz, wuu, wuv, wvv, wzu + w * z * u, wzv + w * z * v


@kernel
def plane_of_sums(sums: Sums, level: float, steepest: float) -> tuple[float, float, float]:
    """Its height at u = v = 0, and its slopes along u and v, within +- steepest.

    Args:
        sums: of one point at least.
        level: weight of a point of knowledge that both slopes are 0; above 0.
    """
    w0, wu, wv, wz, wuu, wuv, wvv, wzu, wzv = sums
    u, v, z = wu / w0, wv / w0, wz / w0
    cuu, cvv, cuv = wuu - w0 * u * u + level, wvv - w0 * v * v + level, wuv - w0 * u * v
    czu, czv = wzu - w0 * z * u, wzv - w0 * z * v
    det = cuu * cvv - cuv * cuv
    a = max(-steepest, min(steepest, (czu * cvv - czv * cuv) / det))
    b = max(-steepest, min(steepest, (czv * cuu - czu * cuv) / det))
    return z - a * u - b * v, a, b
