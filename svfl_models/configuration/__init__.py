"""Typed configuration of the programs of ``svfl-train``, from a YAML file and from the command line.

A program declares its settings once, as the fields of a dataclass (`svfl_models.configuration.setting.option`). Flags,
help texts, checks and the files that ``--print-config`` prints are derived from the fields.
"""
