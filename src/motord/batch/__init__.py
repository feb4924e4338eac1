"""One analysis of many recordings, each by itself: Dask's workers, a ledger of what is done."""
