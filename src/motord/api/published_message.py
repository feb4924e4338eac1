"""What all published messages are."""

from pydantic import BaseModel


class PublishedMessage(BaseModel, extra="ignore"):
    """A published message, or a part of one."""

    def to_json(self) -> bytes:
        """Return JSON in UTF-8; numbers that are not finite become null."""
        return self.model_dump_json().encode()
