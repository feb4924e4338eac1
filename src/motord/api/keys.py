"""The keys of a bench, under `motord/<bench>/`: what each carries, how, and who may ask for it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """A key that the daemon publishes on; `queried`: asked for, it gives what a latecomer needs."""

    name: str
    content: str
    encoding: str
    queried: str = ""


KEYS = (
    Key(
        "state", "the full state, ten times a second and at once when something changes",
        "JSON, `BenchState`", "the newest",
    ),
    Key("event", "what happens, one by one", "JSON, `Event`", "the newest 500"),
    Key(
        "plan", "progress of the plan under way, or how the last one ended",
        "JSON, `PlanView`", "the newest; `null` before the first and after `plan/discard`",
    ),
    Key(
        "mesh",
        "operating points of the plan under way, or of the last one, and what became of each",
        "JSON, `MeshView`", "the newest; `null` as for `plan`",
    ),
    Key("ticks", "every tick, in blocks of `[zenoh] block_s`", "protobuf `motord.Ticks`"),
    Key(
        "tick", "every so many-th tick, `[zenoh] tick_rate_Hz` a second",
        "protobuf `motord.Tick`",
    ),
    Key("rpc/<name>", "requests", "JSON in, JSON out", "the reply, or an error reply"),
    Key("alive", "liveliness token, there as long as the daemon is", ""),
)  # fmt: skip
"""All of them."""
