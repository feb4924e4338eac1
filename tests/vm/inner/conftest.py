"""These tests want a virtual CAN interface of their own: see `tests.vm.test_machine`."""

from tests.contract.peers import SOCKETCAN

collect_ignore_glob = [] if SOCKETCAN else ["test_*.py"]
