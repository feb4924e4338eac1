"""Records of `motord.schema` as protobuf definitions: .proto text and FileDescriptorSet, and back.

For a record `Tick` the file `tick.proto` of package `motord` holds two messages: `Tick`, all
fields of fixed width, and `Ticks`, `repeated Tick ticks = 1`.
"""

from functools import lru_cache

from google.protobuf import descriptor_pb2
from google.protobuf.message import DecodeError

from motord.schema import Field, Record

PACKAGE = "motord"
_TYPES = {
    "double": descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE,
    "float": descriptor_pb2.FieldDescriptorProto.TYPE_FLOAT,
    "sfixed64": descriptor_pb2.FieldDescriptorProto.TYPE_SFIXED64,
    "fixed64": descriptor_pb2.FieldDescriptorProto.TYPE_FIXED64,
    "sfixed32": descriptor_pb2.FieldDescriptorProto.TYPE_SFIXED32,
    "fixed32": descriptor_pb2.FieldDescriptorProto.TYPE_FIXED32,
}
_KINDS = {number: kind for kind, number in _TYPES.items()}

LONGEST_BYTES = 16_384
"""Of a FileDescriptorSet that is read, as those of files are kept; motord's have about 1000."""


def file_name(record: Record) -> str:
    """Return the name of the .proto file of `record`, as in `tick.proto`."""
    return f"{record.name.lower()}.proto"


def list_name(record: Record) -> str:
    """Return the name of the message that repeats `record`, as in `Ticks`."""
    return f"{record.name}s"


def proto_text(record: Record) -> str:
    """Return the .proto source of `record`, with unit and meaning of every field as comments."""
    width = max(len(f"{f.kind} {f.name} = {f.number};") for f in record.fields)
    lines = [
        "// Generated from motord.schema: change it there, then run python -m motord.proto.",
        'syntax = "proto3";',
        "",
        f"package {PACKAGE};",
        "",
        f"// {record.meaning}",
        "// Every field is always written, in this order, defaults too: all messages are as long.",
        f"message {record.name} {{",
    ]
    for f in record.fields:
        definition = f"{f.kind} {f.name} = {f.number};"
        unit = f" [{f.unit}]" if f.unit else ""
        lines.append(f"  {definition:{width}}  //{unit} {f.meaning}")
    repeated = list_name(record)
    lines += [
        "}",
        "",
        f"message {repeated} {{",
        f"  repeated {record.name} {repeated.lower()} = 1;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def descriptor_set(record: Record) -> bytes:
    """Return the FileDescriptorSet of the messages of `record`, as an MCAP schema holds it."""
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{PACKAGE}/{file_name(record)}", package=PACKAGE, syntax="proto3"
    )
    message = file.message_type.add(name=record.name)
    for f in record.fields:
        message.field.add(
            name=f.name,
            number=f.number,
            type=_TYPES[f.kind],
            label=descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL,
        )
    repeated = list_name(record)
    file.message_type.add(name=repeated).field.add(
        name=repeated.lower(),
        number=1,
        type=descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE,
        type_name=f".{PACKAGE}.{record.name}",
        label=descriptor_pb2.FieldDescriptorProto.LABEL_REPEATED,
    )
    return bytes(descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString())


@lru_cache(maxsize=8)
def read_record(descriptor: bytes, full_name: str) -> Record:
    """Return the record that a FileDescriptorSet defines; units and meanings are not in it.

    `full_name` is as in `motord.Tick`. Raises ValueError if the message is not there, has a
    field that is not a single one of fixed width, or fields that share a name or a number, or if
    the set has more than `LONGEST_BYTES`.
    """
    if len(descriptor) > LONGEST_BYTES:
        raise ValueError(f"a FileDescriptorSet of {len(descriptor)} bytes is none of motord's")
    files = descriptor_pb2.FileDescriptorSet()
    try:
        files.ParseFromString(descriptor)
    except DecodeError as error:
        raise ValueError(f"not a FileDescriptorSet: {error}") from error
    for file in files.file:
        for message in file.message_type:
            if f"{file.package}.{message.name}" == full_name:
                return Record(message.name, "", _read_fields(message))
    raise ValueError(f"no message {full_name} in the FileDescriptorSet")


def _read_fields(message: descriptor_pb2.DescriptorProto) -> tuple[Field, ...]:
    fields = tuple(map(_read_field, message.field))
    if not len(fields) == len({f.name for f in fields}) == len({f.number for f in fields}):
        raise ValueError(f"two fields of {message.name} share a name or a number")
    return fields


def _read_field(field: descriptor_pb2.FieldDescriptorProto) -> Field:
    repeated = field.label == descriptor_pb2.FieldDescriptorProto.LABEL_REPEATED
    if field.type not in _KINDS or repeated:
        raise ValueError(f"field {field.name!r} is not of fixed width")
    if not (isinstance(field.name, str) and field.name.isidentifier() and field.number > 0):
        raise ValueError(f"field {field.name!r} is not one that motord could have written")
    return Field(field.number, field.name, _KINDS[field.type], "", "")
