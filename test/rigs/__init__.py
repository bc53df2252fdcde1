"""What tests of several folders use: scenes, bags, processes and faults."""
