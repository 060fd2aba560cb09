"""Parquet tables, by pyarrow."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from algdiff._formats.base import Layout, Options, Samples, Source
from algdiff._formats.even import Even
from algdiff._formats.stage import Stage
from algdiff._formats.tables import Piece, TableSource, choose

BUFFER = 1 << 18
"""Bytes of a column that are read at once."""

NUMBERS = 1 << 18
"""How many are decoded at once."""

GROUP_ROWS, GROUP_BYTES = 1 << 20, 64 << 20
"""Rows and bytes of a row group that is written, at most by a block of the stage more."""


def open_source(path: Path, inner: str | None, options: Options) -> Source:
    """Open the table for reading."""
    return ParquetSource(path, options)


class ParquetSource(TableSource):
    """Columns of a Parquet table. Nulls are NaN."""

    def __init__(self, path: Path, options: Options) -> None:
        with open(path, "rb"):  # whose errors name the file
            pass
        super().__init__(path, pa.OSFile(str(path)))
        try:
            with _whole(path):
                self.table = pq.ParquetFile(
                    self.file, pre_buffer=False, buffer_size=BUFFER, page_checksum_verification=True
                )
                self.schema = self.table.schema_arrow
            self._groups()
            self._choose(options)
        except BaseException:
            self.file.close()
            raise

    def _groups(self) -> None:
        """Find out at which rows row groups begin."""
        metadata = self.table.metadata
        counts = [metadata.row_group(index).num_rows for index in range(metadata.num_row_groups)]
        self.starts = [0, *accumulate(counts)]
        if min(counts, default=0) < 0 or self.starts[-1] != metadata.num_rows:
            raise ValueError(f"{self.path}: not a whole Parquet file ({metadata.num_rows} rows in groups of {counts})")
        if not metadata.num_rows:
            raise ValueError(f"{self.path}: must hold numbers, got none")

    def _choose(self, options: Options) -> None:
        """Decide which columns are read, and as what."""
        names = self.schema.names
        default = [
            position
            for position, name in enumerate(names)
            if _is_number(self.schema.field(position).type) and name not in _index(self.schema)
        ]
        chosen, timed = choose(self.path, options, names, len(names), default)
        self.names = tuple(names[position] for position in chosen)
        for position in {*chosen, *(() if timed is None else (timed,))}:
            if names.count(names[position]) > 1:
                raise ValueError(f"{self.path}: columns must have names of their own, got {names[position]!r} twice")
        self.dtype = self._common(chosen)
        rows = self.starts[-1]
        self.shape = (rows,) if len(chosen) == 1 else (rows, len(chosen))
        if timed is not None:
            self.time = names[timed]
            self._open_times(self.schema.field(timed).type)

    def _common(self, chosen: Sequence[int]) -> np.dtype[Any]:
        """Return the type that holds all chosen columns."""
        types = set()
        for position in chosen:
            name, kind = self.schema.names[position], self.schema.field(position).type
            if not (_is_number(kind) or pa.types.is_boolean(kind)):
                raise ValueError(f"{self.path}: column {name!r} must hold numbers, got {kind}")
            floats = pa.types.is_decimal(kind) or not (pa.types.is_floating(kind) or self._is_full(name))
            types.add(np.dtype(np.float64 if floats else kind.to_pandas_dtype()))
        if len(types) > 1 and any(one.kind == "f" for one in types):
            return np.dtype(np.float64)
        return np.result_type(*types)

    def _is_full(self, name: str) -> bool:
        """Return whether the file says that a column has no nulls."""
        metadata, schema = self.table.metadata, self.table.schema
        column = next(index for index in range(len(schema)) if schema.column(index).path == name)
        if schema.column(column).max_definition_level == 0:
            return True
        found = (metadata.row_group(group).column(column).statistics for group in range(metadata.num_row_groups))
        return all(one is not None and one.has_null_count and one.null_count == 0 for one in found)

    def _open_times(self, kind: pa.DataType) -> None:
        self.time_dtype, rounding = np.dtype(np.float64), 2.0**-53
        if pa.types.is_timestamp(kind):
            self.time_dtype = np.dtype(f"M8[{kind.unit}]")
            if kind.tz is not None:
                self.attributes["time_zone"] = kind.tz
        elif pa.types.is_floating(kind):
            rounding = {16: 2.0**-11, 32: 2.0**-24}.get(kind.bit_width, rounding)
        elif not pa.types.is_integer(kind):
            raise ValueError(f"{self.path}: the times in {self.time!r} must be numbers or timestamps, got {kind}")
        last = first = self._times(next(self._batches(0, [self.time])))
        for batch in self._batches(self.starts[-1] - 1, [self.time]):
            last = self._times(batch)
        both = np.array([first[0], last[-1]], self.time_dtype)
        some = np.concatenate([first, last])
        self._even = Even(self.path, str(self.time), both, self.starts[-1], some, rounding)
        self.step = self._even.step

    def _times(self, batch: pa.RecordBatch) -> Samples:
        column = batch.column(self.time)
        try:
            if not pa.types.is_timestamp(column.type):
                column = pc.cast(column, pa.float64())
        except pa.ArrowInvalid as error:
            raise ValueError(f"{self.path}: the times in {self.time!r} must be seconds, got {error}") from None
        return np.asarray(column.to_numpy(zero_copy_only=False), self.time_dtype)

    def _where(self, row: int) -> str:
        return f"row {row}, column {self.time!r}"

    def _batches(self, row: int, names: Sequence[str | None]) -> Iterator[pa.RecordBatch]:
        """Yield columns from the row group on that holds a row."""
        groups = range(bisect_right(self.starts, row) - 1, len(self.starts) - 1)
        length = max(NUMBERS // len(names), 1)
        with _whole(self.path):
            yield from self.table.iter_batches(length, list(groups), list(names), use_threads=False)

    def _pieces(self, row: int) -> Iterator[Piece]:
        first = self.starts[bisect_right(self.starts, row) - 1]
        names = self.names or ()
        for batch in self._batches(row, names if self.time is None else list(dict.fromkeys((*names, self.time)))):
            numbers = np.empty((batch.num_rows, len(names)), self.dtype)
            for position, name in enumerate(names):
                numbers[:, position] = self._numbers(name, batch.column(name))
            yield Piece(first, numbers, None if self.time is None else self._times(batch))
            first += batch.num_rows

    def _numbers(self, name: str, column: pa.Array) -> Samples:
        if self.dtype.kind != "f" and column.null_count:
            raise ValueError(f"{self.path}: not a whole Parquet file (nulls in {name!r}, which has none)")
        if pa.types.is_boolean(column.type):
            column = pc.cast(column, pa.uint8())
        elif pa.types.is_decimal(column.type):
            column = pc.cast(column, pa.float64())
        return np.asarray(column.to_numpy(zero_copy_only=False))


@contextmanager
def _whole(path: Path) -> Iterator[None]:
    """Let errors of the format name the file."""
    try:
        yield
    except (pa.ArrowException, OSError, EOFError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: not a whole Parquet file ({' '.join(str(error).split())})") from None


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind))


def _index(schema: pa.Schema) -> list[str]:
    """Return the columns in which pandas keeps an index."""
    try:
        columns = json.loads(schema.metadata[b"pandas"])["index_columns"]
    except (TypeError, KeyError, ValueError):
        return []
    return [name for name in columns if isinstance(name, str)] if isinstance(columns, list) else []


def check(path: Path, inner: str | None, layout: Layout) -> None:
    """Columns need names of their own."""
    names = _schema(layout).names
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"the columns of a .parquet OUT must have names of their own, got {twice!r} twice")


def encode(stage: Stage, path: Path, inner: str | None, layout: Layout) -> None:
    """Write the table: row groups of a million rows, or fewer if they are wide."""
    schema = _schema(layout)
    # On noisy derivatives bytes apart take 0.55 (float32: 0.37) of the room and zstd's time; snappy alone takes 0.84.
    encodings = {
        field.name: "DELTA_BINARY_PACKED" if pa.types.is_timestamp(field.type) else "BYTE_STREAM_SPLIT"
        for field in schema
    }
    options = {"compression": "zstd", "use_dictionary": False, "column_encoding": encodings}
    with pq.ParquetWriter(path, schema, write_page_checksum=True, **options) as writer:
        held: list[pa.Table] = []
        for numbers, times in stage.rows():
            columns = [pa.array(numbers[:, position]) for position in range(numbers.shape[1])]
            if times is not None:
                columns.insert(0, pa.array(times, schema.field(0).type))
            held.append(pa.Table.from_arrays(columns, schema=schema))
            if sum(len(one) for one in held) >= GROUP_ROWS or sum(one.nbytes for one in held) >= GROUP_BYTES:
                writer.write_table(pa.concat_tables(held), GROUP_ROWS)
                held.clear()
        if held:
            writer.write_table(pa.concat_tables(held), GROUP_ROWS)


def _schema(layout: Layout) -> pa.Schema:
    """Return names and types of the columns: times in front, with the type they had."""
    names = layout.columns or [f"x{position}" for position in range(layout.rows[1])]
    fields = [pa.field(name, pa.from_numpy_dtype(layout.dtype)) for name in names]
    if layout.time is not None:
        kind = pa.float64()
        if layout.time_dtype is not None and layout.time_dtype.kind == "M":
            unit = np.datetime_data(layout.time_dtype)[0]
            kind = pa.timestamp(unit, layout.attributes.get("time_zone"))
        fields.insert(0, pa.field(layout.time, kind))
    return pa.schema(fields)
