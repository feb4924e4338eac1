"""What all published messages are."""

from pydantic import BaseModel, ConfigDict


class PublishedMessage(BaseModel):
    """A published message, or a part of one."""

    model_config = ConfigDict(extra="ignore")

    def to_json(self) -> bytes:
        """Return JSON in UTF-8; numbers that are not finite become null."""
        return self.model_dump_json().encode()
