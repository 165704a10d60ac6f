"""Tables of a drive, written as they grow: CSV, or Parquet with pyarrow (an extra).

Each row has its instant twice: `t_s`, the host's monotonic clock, and `utc_ns`.
"""

import csv
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np
import numpy.typing as npt

Columns = dict[str, npt.NDArray[Any]]  # by name, all of one length
F8, I8 = np.dtype("f8"), np.dtype("i8")
TIMES = {"t_s": F8, "utc_ns": I8}
TABLES: dict[str, dict[str, np.dtype[Any]]] = {
    "pose": TIMES
    | dict.fromkeys(("x_m", "y_m", "yaw_rad", "pitch_rad", "roll_rad", "v_mps", "w_radps"), F8),
    "health": TIMES
    | dict.fromkeys(("mode", "health"), I8)
    | dict.fromkeys(("age_scan_s", "age_ahrs_s", "age_enc_s"), F8),
    "scans": TIMES
    | dict.fromkeys(("counter", "beam", "echo"), I8)
    | dict.fromkeys(("bearing_rad", "elevation_rad", "range_m"), F8),
    "wheels": TIMES
    | dict.fromkeys(("left_counts", "right_counts", "unpowered_s"), F8)
    | {"restarts": I8},
    "attitude": TIMES
    | dict.fromkeys(("q_w", "q_x", "q_y", "q_z", "rate_x_radps", "rate_y_radps"), F8)
    | {"rate_z_radps": F8},
}
CHUNK_ROWS = 100_000  # of a row group


class TableFile(Protocol):
    """One table on its way to a file."""

    def add(self, columns: Columns) -> None: ...

    def close(self) -> None: ...


class CsvFile:
    """Numbers with all their digits; what is not known is an empty field."""

    def __init__(self, path: Path, names: list[str]) -> None:
        self._names = names
        self._file: TextIO = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file)
        self._writer.writerow(names)

    def add(self, columns: Columns) -> None:
        lists = [_texts(columns[name]) for name in self._names]
        self._writer.writerows(zip(*lists, strict=True))

    def close(self) -> None:
        self._file.close()


def _texts(values: npt.NDArray[Any]) -> list[Any]:
    """NaN as nothing."""
    listed: list[Any] = values.tolist()
    if values.dtype.kind == "f" and np.isnan(values).any():
        return ["" if value != value else value for value in listed]
    return listed


class ParquetFile:
    """Columns of 64 bits; what is not known is NaN."""

    def __init__(self, path: Path, names: list[str], kinds: list[np.dtype[Any]]) -> None:
        import pyarrow as pa  # an extra
        import pyarrow.parquet as pq

        self._pa = pa
        fields = [(name, pa.from_numpy_dtype(of)) for name, of in zip(names, kinds, strict=True)]
        self._schema = pa.schema(fields)
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")
        self._waiting: list[Columns] = []
        self._rows = 0

    def add(self, columns: Columns) -> None:
        self._waiting.append(columns)
        self._rows += columns["t_s"].size
        if self._rows >= CHUNK_ROWS:
            self._write()

    def close(self) -> None:
        self._write()
        self._writer.close()

    def _write(self) -> None:
        if self._waiting:
            names = self._schema.names
            joined = [
                self._pa.array(np.concatenate([part[name] for part in self._waiting]))
                for name in names
            ]
            self._writer.write_table(self._pa.Table.from_arrays(joined, schema=self._schema))
            self._waiting, self._rows = [], 0


class Tables:
    """All tables of a drive in one folder."""

    def __init__(self, folder: Path, form: str) -> None:
        """`form`: "csv" or "parquet"."""
        self.rows = dict.fromkeys(TABLES, 0)
        self.paths = {name: folder / f"{name}.{form}" for name in TABLES}
        self._files: dict[str, TableFile] = {
            name: CsvFile(self.paths[name], list(columns))
            if form == "csv"
            else ParquetFile(self.paths[name], list(columns), list(columns.values()))
            for name, columns in TABLES.items()
        }

    def add(self, table: str, columns: Columns) -> None:
        """Rows, in any number."""
        typed = {name: np.asarray(columns[name], kind) for name, kind in TABLES[table].items()}
        if typed["t_s"].size:
            self.rows[table] += typed["t_s"].size
            self._files[table].add(typed)

    def close(self) -> None:
        for file in self._files.values():
            file.close()
