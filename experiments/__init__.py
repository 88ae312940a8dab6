"""How measurements come about: plans, procedure, rigs, sensors, makers, demo runs, studies.

Imports go one way: studies, recording, schema > controller > rigs > procedure > sensors; plans (below
controller and studies), makers use none of these; simulate and processes are below all.
"""
