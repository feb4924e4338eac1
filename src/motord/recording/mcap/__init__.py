"""MCAP files: records, chunks of messages, the file around them, salvage of broken ones."""
