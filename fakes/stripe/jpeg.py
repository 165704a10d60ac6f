"""Images of the fake camera as JPEG files, whole or damaged, by Pillow."""

import io
import random

from PIL import Image

from fakes.stripe.drawing import U8
from fakes.stripe.faults import Faults

SUBSAMPLING = 1  # 4:2:2, as web cameras have it
HEAD_BYTES = 700  # of tables before the image itself
END = b"\xff\xd9"


def jpeg_from_image(image: U8, faults: Faults) -> bytes:
    """The file of an image (h, w, 3), blue green red, in the size that is sent."""
    picture = Image.fromarray(image[:, :, ::-1].copy(), "RGB")
    width, height = faults.image_px
    if picture.size != (width, height):
        picture = picture.resize((width, height))
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=int(faults.quality), subsampling=SUBSAMPLING)
    return out.getvalue()


def damaged(jpeg: bytes, faults: Faults, chance: random.Random) -> bytes:
    """What its faults leave of a file."""
    if chance.random() < faults.truncated_rate:
        return jpeg[: chance.randrange(HEAD_BYTES, len(jpeg) - len(END))]
    if chance.random() < faults.torn_rate:
        first = chance.randrange(HEAD_BYTES, len(jpeg) - len(END))
        return jpeg[:first] + jpeg[chance.randrange(first, len(jpeg) - len(END)) :]
    return jpeg
