"""Binary measurement files, read by the packages of their formats: TDMS and MDF 4."""
