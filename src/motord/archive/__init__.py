"""Verified copies of recordings in a folder of another disk or computer: the archive.

`selection` finds whole recordings, `verified_copy` makes one copy, `archive` keeps manifests and
says what is archived, `pace` limits the bandwidth and stops when the bench is needed.
"""
