"""Readers for the loop dialects the world already has, one file a dialect, into the records of
`framework.model.description`; and the writer of our own robot file."""

from framework.model.readers.recognise import DIALECTS, parse_any, read_any
from framework.model.robot_file_writer import spring_entry, write_robot_file

__all__ = ["DIALECTS", "parse_any", "read_any", "spring_entry", "write_robot_file"]
