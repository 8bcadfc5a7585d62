"""Running a plan: workers, clocks, the bus between them, the launcher that watches."""
