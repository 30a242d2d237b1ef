"""What all programs of this software share: parsing, help, completion, one-line errors, exit codes and reports."""

from svfl_data.system.command_line.argument_types import between as between
from svfl_data.system.command_line.argument_types import natural as natural
from svfl_data.system.command_line.argument_types import port as port
from svfl_data.system.command_line.argument_types import positive as positive
from svfl_data.system.command_line.argument_types import yes_no as yes_no
from svfl_data.system.command_line.parser import Commands as Commands
from svfl_data.system.command_line.parser import Parser as Parser
from svfl_data.system.command_line.parser import complete_with as complete_with
from svfl_data.system.command_line.report import add_json as add_json
from svfl_data.system.command_line.report import report as report
from svfl_data.system.command_line.running import Ended as Ended
from svfl_data.system.command_line.running import main as main
from svfl_data.system.command_line.running import run as run
