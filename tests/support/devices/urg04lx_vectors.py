"""The replies printed in the urg04lx sheet, by their names."""

import ast

from tests import VECTORS


def _rows() -> list[list[str]]:
    text = (VECTORS / "urg04lx_replies.tsv").read_text(encoding="utf-8")
    return [line.split("\t") for line in text.splitlines() if not line.startswith("#")]


REPLIES: dict[str, bytes] = {
    name: ast.literal_eval('b"' + written.replace('"', '\\"') + '"')
    for name, written, *_ in _rows()
}
STATUSES = {name: status for name, _, status, _ in _rows()}
CONTENTS = {name: content for name, *_, content in _rows()}
