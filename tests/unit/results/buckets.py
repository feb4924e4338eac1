"""An object store in memory as fsspec has it, at `bucket://`, with faults put into it."""

import fsspec
from fsspec.spec import AbstractFileSystem

BUCKET = "motors"
URL = f"bucket://anna:secret@{BUCKET}/line 1"
SHOWN = f"bucket://{BUCKET}/line 1"


class NoCredentials(Exception):
    """An error of a library of its own, as boto has them: no OSError."""


class Bucket(AbstractFileSystem):
    """Objects by their keys; a prefix is there if an object has it, as of S3.

    fault: called with each operation and key before it is done.
    """

    protocol = "bucket"
    cachable = False
    objects: dict[str, bytes] = {}
    puts: list[str] = []
    fault = staticmethod(lambda operation, key: None)
    atomic = True

    @classmethod
    def _strip_protocol(cls, path):
        return super()._strip_protocol(path).rpartition("@")[2]

    def ls(self, path, detail=True, **_):
        self.fault("ls", path)
        prefix = f"{path.rstrip('/')}/"
        found = sorted(key for key in self.objects if key.startswith(prefix))
        if not found:
            raise FileNotFoundError(path)
        entries = [{"name": k, "size": len(self.objects[k]), "type": "file"} for k in found]
        return entries if detail else found

    def cat_file(self, path, start=None, end=None, **_):
        self.fault("get", path)
        try:
            return self.objects[path]
        except KeyError:
            raise FileNotFoundError(path) from None

    def pipe_file(self, path, value, mode="overwrite", **_):
        if not self.atomic:
            self.objects[path] = bytes(value[: len(value) // 2])
        self.fault("put", path)
        self.puts.append(path)
        self.objects[path] = bytes(value)

    def rm_file(self, path):
        self.fault("rm", path)
        del self.objects[path]


def bucket(fault=lambda operation, key: None, atomic=True):
    """Return an empty bucket, which `bucket://` names from here on."""
    made = type("TestBucket", (Bucket,), {"objects": {}, "puts": [], "atomic": atomic})
    made.fault = staticmethod(fault)
    fsspec.register_implementation("bucket", made, clobber=True)
    return made


def failing(error, *operations):
    """Return a fault: this error in these operations, but for the probe's."""

    def fault(operation, key):
        if operation in operations and not key.endswith("probe"):
            raise error

    return fault
