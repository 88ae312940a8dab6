"""How measurements come about: plans, procedure, rigs, sensors, importers, exporters, demo runs, studies.

Imports go one way: studies, recording, schema > rigs > procedure > sensors; plans (below
studies), importers and exporters use none of these; simulate and processes are below all.
"""
