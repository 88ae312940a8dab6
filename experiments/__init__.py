"""How measurements come about: plans, procedure, rigs, sensors, importers, exporters, demo runs, studies.

Imports go one way: studies, recording, schema > controller > rigs > procedure > sensors; plans (below
controller and studies), importers and exporters use none of these; simulate and processes are below all.
"""
