"""How deep the stack of an image can get, from what the compiler reports (-fcallgraph-info=su)."""

import re
from functools import cache

_NODE = re.compile(r'node: { title: "([^"]+)" label: "([^"]+)"')
_EDGE = re.compile(r'edge: { sourcename: "([^"]+)" targetname: "([^"]+)"')
_BYTES = re.compile(r"(\d+) bytes \((static|dynamic,bounded|dynamic)\)")
LIBRARY_BYTES = 64
"""Of memcpy and its like, which come without an account."""


class CallGraph:
    """The functions of an image with the stack each takes and whom it calls."""

    def __init__(self, folder, indirect):
        """Read all .ci files below `folder`; `indirect` names what function pointers point to."""
        self.stack_bytes = {}
        self.kinds = set()
        self._calls = {}
        self._indirect = indirect
        for path in sorted(folder.rglob("*.ci")):
            self._read(path.read_text())

    def _read(self, text):
        for title, label in _NODE.findall(text):
            found = _BYTES.search(label)
            if found:
                self.stack_bytes[title] = int(found[1])
                self.kinds.add(found[2])
        for source, target in _EDGE.findall(text):
            self._calls.setdefault(source, set()).add(target)

    def depth(self, function):
        """Return the bytes of stack that `function` and all that it calls can take."""

        @cache
        def below(name, above):
            assert name not in above, f"{name} calls itself"
            called = self._calls.get(name, set())
            if "__indirect_call" in called:
                called = (called - {"__indirect_call"}) | set(self._indirect)
            inner = (below(each, above | {name}) for each in called)
            return self.stack_bytes.get(name, LIBRARY_BYTES) + max(inner, default=0)

        return below(function, frozenset())
