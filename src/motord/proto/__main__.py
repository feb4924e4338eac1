"""Write the .proto files that ship with motord anew, from `motord.schema`."""

from motord.proto import write

write()
