"""Blocks of records against google.protobuf, which knows nothing of fixed layouts."""

from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given, settings
from hypothesis import strategies as st

from motord import proto
from motord.schema import TICK, TICK_DTYPE, TRUTH, Field, Record
from motord.wire.ticks.blocks import BlockCodec, varint
from motord.wire.ticks.pattern import ROWS_AT_ONCE
from motord.wire.ticks.proto_text import LONGEST_BYTES, descriptor_set, proto_text, read_record

WIDE_NUMBERS = Record(
    "Wide",
    "Field numbers whose tags have one, two and three bytes, not in order.",
    (
        Field(2048, "far", "double", "", ""),
        Field(1, "near", "fixed32", "", ""),
        Field(15, "last_short", "sfixed64", "", ""),
        Field(16, "first_long", "float", "", ""),
        Field(2047, "last_long", "fixed64", "", ""),
    ),
)
RECORDS = (TICK, TRUTH, WIDE_NUMBERS)
records = pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.name)


def message_class(record: Record, name: str) -> type[Any]:
    files = descriptor_pb2.FileDescriptorSet.FromString(descriptor_set(record))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"motord.{name}"))


def block_of(record: Record, seed: int, count: int, *, plain: bool = False) -> np.ndarray:
    """Random bits in every field; `plain`: neither zero nor nan, which proto3 would not keep."""
    rng = np.random.default_rng(seed)
    block = np.frombuffer(rng.bytes(record.dtype.itemsize * count), record.dtype).copy()
    if plain:
        for name in record.dtype.names:
            column = block[name]
            column[(column == 0) | (column != column)] = 1
    return block


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    assert a.dtype.names == b.dtype.names
    assert a.shape == b.shape
    return all(a[name].tobytes() == b[name].tobytes() for name in a.dtype.names)


@given(st.sampled_from(RECORDS), st.integers(0, 2**32), st.integers(0, ROWS_AT_ONCE + 3))
@settings(deadline=None, max_examples=40)
def test_a_block_comes_back_as_it_was(record, seed, count):
    codec, block = BlockCodec(record), block_of(record, seed, count)
    encoded = codec.encode(block)
    assert encoded.shape == (count, codec.size)
    assert same_bits(codec.decode(encoded.tobytes()), block)
    assert same_bits(codec.decode(encoded), block)
    assert same_bits(codec.decode_list(codec.encode_list(block)), block)


@given(st.sampled_from(RECORDS), st.integers(0, 2**32))
@settings(deadline=None, max_examples=40)
def test_google_protobuf_writes_the_same_bytes(record, seed):
    block = block_of(record, seed, 3, plain=True)
    message = message_class(record, record.name)
    for row, encoded in zip(block, BlockCodec(record).encode(block), strict=True):
        values = {name: row[name].item() for name in record.dtype.names}
        assert message(**values).SerializeToString() == encoded.tobytes()


@given(st.sampled_from(RECORDS), st.integers(0, 2**32), st.integers(0, 5))
@settings(deadline=None, max_examples=40)
def test_google_protobuf_reads_the_same_values(record, seed, count):
    block = block_of(record, seed, count)
    if count:
        block[0] = np.zeros((), record.dtype)  # defaults are written too
    codec = BlockCodec(record)
    one, many = message_class(record, record.name), message_class(record, f"{record.name}s")
    parsed = [one.FromString(row.tobytes()) for row in codec.encode(block)]
    listed = getattr(many.FromString(codec.encode_list(block)), f"{record.name.lower()}s")
    assert len(listed) == count
    for row, single, element in zip(block, parsed, listed, strict=True):
        for name in record.dtype.names:
            for message in (single, element):
                value = np.array(getattr(message, name), record.dtype[name])
                np.testing.assert_array_equal(value, row[name])


@records
def test_a_message_of_zeros_is_as_long_as_any(record):
    codec = BlockCodec(record)
    assert codec.encode(np.zeros(1, record.dtype)).nbytes == codec.size
    widths = sum(record.dtype[name].itemsize for name in record.dtype.names)
    tags = sum(len(varint(field.number << 3)) for field in record.fields)
    assert codec.size == widths + tags


@records
def test_columns_come_in_the_order_asked_for_and_aligned(record):
    codec, block = BlockCodec(record), block_of(record, 1, 7)
    columns = list(reversed(record.dtype.names))[:3]
    chosen = codec.decode(codec.encode(block), columns=[*columns, columns[0]])
    assert list(chosen.dtype.names) == columns
    assert chosen.dtype.isalignedstruct
    for name in columns:
        assert chosen[name].tobytes() == block[name].tobytes()


def test_decoded_blocks_are_of_the_dtype_of_the_ring():
    codec = BlockCodec(TICK)
    assert codec.decode(codec.encode(np.zeros(2, TICK_DTYPE))).dtype == TICK_DTYPE
    assert codec.decode(b"").shape == (0,)
    assert codec.encode_list(np.zeros(0, TICK_DTYPE)) == b""


def test_blocks_of_other_layouts_are_encoded_by_name():
    codec, block = BlockCodec(TICK), block_of(TICK, 3, 9)
    backwards = np.empty(9, [(name, TICK_DTYPE[name]) for name in reversed(TICK_DTYPE.names)])
    for name in TICK_DTYPE.names:
        backwards[name] = block[name]
    assert codec.encode(backwards).tobytes() == codec.encode(block).tobytes()
    assert codec.encode(block[::2]).tobytes() == codec.encode(block)[::2].tobytes()


def test_an_unknown_column_is_named():
    with pytest.raises(ValueError, match="no column voltage; it has t_ns, tick"):
        BlockCodec(TICK).decode(b"", columns=["voltage"])


@given(st.integers(0, 2**32), st.data())
@settings(deadline=None, max_examples=60)
def test_other_tags_are_refused_wherever_they_are(seed, data):
    codec = BlockCodec(TICK)
    encoded = codec.encode(block_of(TICK, seed, 6))
    row = data.draw(st.integers(0, 5))
    byte = data.draw(st.sampled_from(np.flatnonzero(codec.pattern.mask).tolist()))
    encoded[row, byte] ^= data.draw(st.integers(1, 255))
    with pytest.raises(ValueError, match=f"message {row} of 6 is not a Tick"):
        codec.decode(encoded)


def test_a_foreign_tag_late_in_a_long_block_is_found():
    codec = BlockCodec(TICK)
    encoded = codec.encode(np.zeros(2 * ROWS_AT_ONCE, TICK_DTYPE))
    encoded[ROWS_AT_ONCE + 1, 0] ^= 1
    with pytest.raises(ValueError, match=f"message {ROWS_AT_ONCE + 1} of"):
        codec.decode(encoded)


def test_parts_of_messages_are_refused():
    codec = BlockCodec(TICK)
    encoded = codec.encode(np.zeros(2, TICK_DTYPE)).tobytes()
    with pytest.raises(ValueError, match="453 bytes are not whole Ticks of 227 bytes"):
        codec.decode(encoded[:-1])
    with pytest.raises(ValueError, match="not whole Ticks of 230 bytes"):
        codec.decode_list(encoded)
    with pytest.raises(ValueError, match="message 0 of 227"):
        codec.decode_list(bytes(227 * 230))


def test_shipped_proto_files_are_current():
    shipped = {path: path.read_text() for path, _ in proto.definitions()}
    assert shipped == dict(proto.definitions()), "run python -m motord.proto"
    assert {path.name for path in proto.FOLDER.glob("*.proto")} == {"tick.proto", "truth.proto"}


def test_proto_files_are_written_to_their_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(proto, "FOLDER", tmp_path)
    proto.write()
    assert (tmp_path / "tick.proto").read_text() == proto_text(TICK)


@records
def test_proto_text_gives_every_field_its_unit_and_meaning(record):
    text = proto_text(record)
    for field in record.fields:
        line = next(row for row in text.splitlines() if f" {field.name} = {field.number};" in row)
        assert line.strip().startswith(f"{field.kind} ")
        assert line.endswith(field.meaning)
        assert (f"// [{field.unit}]" in line) == bool(field.unit)


@records
def test_a_record_is_read_back_from_its_descriptor(record):
    read = read_record(descriptor_set(record), f"motord.{record.name}")
    assert read.name == record.name
    assert [(f.number, f.name, f.kind) for f in read.fields] == [
        (f.number, f.name, f.kind) for f in record.fields
    ]
    assert BlockCodec(read).pattern.template.tobytes() == (
        BlockCodec(record).pattern.template.tobytes()
    )


def test_descriptors_that_are_not_of_fixed_layout_are_refused():
    with pytest.raises(ValueError, match="not a FileDescriptorSet"):
        read_record(b"\xff\xff\xff", "motord.Tick")
    with pytest.raises(ValueError, match=r"no message motord\.Tock"):
        read_record(descriptor_set(TICK), "motord.Tock")
    with pytest.raises(ValueError, match="field 'ticks' is not of fixed width"):
        read_record(descriptor_set(TICK), "motord.Ticks")
    padding = descriptor_set(TICK)
    while len(padding) <= LONGEST_BYTES:
        padding += padding
    with pytest.raises(ValueError, match=r"of \d+ bytes is none of motord's"):
        read_record(padding, "motord.Tick")
    number = Field(3, "x", "float", "", "")
    for fields, reason in (
        ((number, Field(4, "x", "float", "", "")), "share a name"),
        ((number, Field(3, "y", "float", "", "")), "share a name or a number"),
        ((Field(3, "x y", "float", "", ""),), "'x y' is not one that motord"),
        ((Field(-3, "x", "float", "", ""),), "'x' is not one that motord"),
    ):
        other = descriptor_set(Record("Tick", "", fields))
        with pytest.raises(ValueError, match=reason):
            read_record(other, "motord.Tick")
