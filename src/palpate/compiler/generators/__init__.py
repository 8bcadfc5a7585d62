"""The code that numba generates for intrinsics. Each module needs numba, and is imported when one is first used."""
