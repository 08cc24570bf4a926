"""One loader: the Python call and the command line read the same files, each of them once."""

import xml.etree.ElementTree as ElementTree
from collections import Counter

import pytest
import yaml

import robots
from framework import ParallelRobot, RobotFileError
from framework.cli import main
from framework.model import read_robot_file
from framework.model.documents import parse_yaml
from framework.model.readers import read_any
from tests.model.readers.test_dialects import FIVE_BARS
from tests.robots.every_robot import KINDS
from tests.watchdog import bounded

QUICK = 5.0  # [s] of processor time in which a file is refused


@pytest.fixture
def parses(monkeypatch) -> Counter[str]:
    """How often a text was parsed, by its format, since the test began."""
    count: Counter[str] = Counter()

    class XMLParser(ElementTree.XMLParser):
        def __init__(self, *given, **options) -> None:
            count["XML"] += 1
            super().__init__(*given, **options)

    first_step = yaml.composer.Composer.__init__

    def counted(self) -> None:
        count["YAML"] += 1
        first_step(self)

    monkeypatch.setattr(ElementTree, "XMLParser", XMLParser)
    monkeypatch.setattr(yaml.composer.Composer, "__init__", counted)
    return count


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize(
    "name", ["five_bar", "standing_quadruped", "two_arms"]
)  # the last two edit their URDF
def test_a_robot_takes_one_parse_of_each_of_its_files(parses, name, flexibility):
    entry = robots.CATALOGUE[name]
    parses.clear()
    assert ParallelRobot.from_file(entry.file, flexibility=flexibility).name == name
    assert parses == {"XML": 1, "YAML": 1}


@pytest.mark.parametrize("name", FIVE_BARS)
def test_every_dialect_takes_one_parse_of_each_of_its_files(parses, name):
    file, options = FIVE_BARS[name]
    ParallelRobot.from_file(file, **options)
    assert parses == {"XML": 1, "YAML": 1} if name in ("own", "gepetto", "gepetto folder") else {"XML": 1}


@pytest.mark.parametrize("name", KINDS)
def test_the_urdf_that_was_read_is_the_one_that_the_text_says(name):
    file = robots.CATALOGUE[name].file
    direct = ParallelRobot.from_file(file, flexibility="flexible_links")
    again = ParallelRobot.from_description(read_robot_file(file), flexibility="flexible_links")
    assert direct.description == again.description
    assert direct.model == again.model  # joints, placements, inertias, limits, to the last bit


def bomb(levels: int) -> str:
    """A YAML text of a few lines that is 9^levels values with its aliases written out."""
    lines = ["a0: &a0 [" + ", ".join(["x"] * 9) + "]"]
    lines += [f"a{k}: &a{k} [" + ", ".join([f"*a{k - 1}"] * 9) + "]" for k in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize("reading", [ParallelRobot.from_file, read_any, read_robot_file])
@pytest.mark.parametrize("place", ["alone", "in a robot file", "in a pair"])
def test_an_alias_bomb_is_refused_at_once(write_robot, reading, place):
    file = write_robot()
    above = {
        "alone": "",
        "in a robot file": file.read_text(encoding="utf-8"),
        "in a pair": "closed_loop: []\n",
    }
    file.write_text(above[place] + bomb(30), encoding="utf-8")
    with (
        bounded(QUICK),
        pytest.raises(RobotFileError, match=r"my_robot\.yaml: aliases: more than 20000 values"),
    ):
        reading(file)


def test_aliases_count_as_what_they_stand_for():
    """300 values, then 100 aliases of a pair: 600 values, not 100 times all that came before."""
    entries = [*["x"] * 300, "&pair [1, 2]", *["*pair"] * 100]
    assert parse_yaml(f"[{', '.join(entries)}]")[-100:] == [[1, 2]] * 100


def test_a_long_list_is_refused_while_it_is_read(monkeypatch):
    made: Counter[type] = Counter()
    make = yaml.ScalarNode.__init__

    def counted(node: yaml.ScalarNode, *given, **options) -> None:
        made[type(node)] += 1
        make(node, *given, **options)

    monkeypatch.setattr(yaml.ScalarNode, "__init__", counted)
    with pytest.raises(RobotFileError, match="more than 20000 values"):
        parse_yaml("[" + "1," * 21_000 + "]")
    assert made[yaml.ScalarNode] <= 20_000


@pytest.mark.parametrize("given", ["unknown key", "no loops", "too little said", "nothing there"])
def test_the_command_line_and_the_call_complain_alike(write_robot, capsys, given):
    own = write_robot(("surprise", 1))
    file = {
        "unknown key": own,
        "no loops": own.with_name("five_bar.urdf"),
        "too little said": FIVE_BARS["ros"][0],
        "nothing there": own.with_name("missing.yaml"),
    }[given]
    with pytest.raises(RobotFileError) as caught:
        ParallelRobot.from_file(file)
    assert main(["check", str(file)]) == 2
    assert str(caught.value) in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_the_limit_of_a_joint_is_of_numbers_in_every_dialect(write_robot, tmp_path, kind):
    texts = {name: FIVE_BARS[name][0].read_text(encoding="utf-8") for name in ("urdf+", "ros")}
    own = write_robot(urdf=(('type="revolute"', f'type="{kind}"'), ('effort="200"', 'effort="strong"')))
    with pytest.raises(RobotFileError, match=r"joint 'left_motor': <limit> effort: needs finite numbers"):
        ParallelRobot.from_file(own)
    for name, text in texts.items():
        file = tmp_path / f"{name}.urdf"
        text = text.replace('type="revolute"', f'type="{kind}"', 1)
        file.write_text(text.replace('effort="1"', 'effort="strong"', 1), encoding="utf-8")
        with pytest.raises(RobotFileError, match=r"joint 'left_motor': <limit> effort: needs finite numbers"):
            ParallelRobot.from_file(file, **FIVE_BARS[name][1])


def test_a_limit_that_leaves_no_room_is_refused(write_robot):
    file = write_robot(urdf=(('lower="-6.28" upper="6.28"', 'lower="1" upper="-1"'),))
    with pytest.raises(RobotFileError, match=r"joint 'left_motor': <limit>: needs lower <= upper"):
        ParallelRobot.from_file(file)
