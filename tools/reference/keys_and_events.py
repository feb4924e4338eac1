"""What the keys of a bench carry, and what its events are about: the daemon publishes them."""

KEYS = (
    (
        "state", "the full state, ten times a second and at once when something changes",
        "JSON, `BenchState`", "the newest",
    ),
    ("event", "what happens, one by one", "JSON, `Event`", "the newest 500"),
    (
        "plan", "progress of the plan under way, or how the last one ended",
        "JSON, `PlanView`", "the newest; `null` before the first and after `plan/discard`",
    ),
    (
        "mesh",
        "operating points of the plan under way, or of the last one, and what became of each",
        "JSON, `MeshView`", "the newest; `null` as for `plan`",
    ),
    ("ticks", "every tick, in blocks of `[zenoh] block_s`", "protobuf `motord.Ticks`", ""),
    (
        "tick", "every so many-th tick, `[zenoh] tick_rate_Hz` a second",
        "protobuf `motord.Tick`", "",
    ),
    ("rpc/<name>", "requests", "JSON in, JSON out", "the reply, or an error reply"),
    ("alive", "liveliness token, there as long as the daemon is", "", ""),
)  # fmt: skip
"""Under `motord/<bench>/`: name, content, encoding, and what a query returns."""

EVENT_MEANING: dict[str, str] = {
    "access": "a client of another machine came in, was refused or lost its role",
    "blackbox": "a black box was asked for, written, or could not be",
    "bridge": "the bridge board is barred by a host of another protocol",
    "calibration": "a calibration is in force, was installed, cannot be used or holds again",
    "calibration_departed": "operation shows a quantity outside its interval in the calibration in "
    "force: both values, and what to do",
    "channel": "the status of a slow channel changed",
    "daemon": "the daemon shuts down, and why",
    "device": "the health of a slow device changed, or the torque was taken away because of it",
    "fault": "an error in the program or a loop that ended; the bench is stopped",
    "fault_injected": "a fault was injected on purpose into a simulated or emulated bench",
    "import": "a recording from elsewhere was imported: what was left out, and why",
    "journal": "the journal of plans cannot be read or written",
    "lease": "command was taken, given up or lost",
    "loop_restarted": "in a recording: the loop was started again",
    "missed": "the loop skipped ticks",
    "note": "a remark by an operator",
    "plan": "a plan was started, paused, resumed or ended",
    "process": "a process of the daemon ended or sent what is no message",
    "queue": "the queue of plans was started, paused or edited, or one of its runs ended",
    "recorder_restarted": "in a recording: the recorder was started again",
    "recording": "the recorder reports an error, or what became of a file that was cut off",
    "recording_ended": "in a recording: why it ended early",
    "recording_resumed": "in a recording: it goes on after the disk had ended it",
    "recovered": "in a recording: made from one that was cut off",
    "request": "an operator asked for a change of state, and who",
    "ring_loss": "the supervisor fell behind and lost ticks; the recording has them",
    "ring_lost": "in a recording: ticks that the ring overwrote before they were read",
    "state": "the state of the drive changed",
    "timing": "how punctual the loop was since the event before",
    "trip": "an interlock fired: causes, values with their limits, what to do, black box",
}
"""What each kind of event is about."""
