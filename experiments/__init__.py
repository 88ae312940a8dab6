"""How measurements come about: plans, procedure, rigs, sensors, makers, demo runs, studies.

Imports go one way: studies, recording, schema > rigs > procedure > sensors; plans (below
studies), makers use none of these; simulate and processes are below all.
"""
