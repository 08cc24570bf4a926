"""The page is served to this machine alone, and answers without falling over."""

import http.client
import json
import threading

import pytest

import robots
from framework import InvalidInput, assemble
from framework.show.jogging import MAX_REQUEST_BYTES, PageServer, move_by_hand
from tests.watchdog import PATIENCE

ROBOT = robots.load("five_bar")


@pytest.fixture(scope="module")
def server():
    made = PageServer("<p>the page</p>", lambda asked: move_by_hand(ROBOT, asked))
    thread = threading.Thread(target=made.serve_until_interrupted)
    thread.start()
    yield made
    made.shutdown()
    thread.join()


@pytest.fixture
def ask(server):
    def send(method: str, path: str, body: bytes | str = b"", **headers: str):
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE)
        connection.request(method, path, body, {key.title(): value for key, value in headers.items()})
        reply = connection.getresponse()
        content = reply.read()
        connection.close()
        return reply.status, content

    return send


def movement(**changes) -> str:
    return json.dumps(
        {"q": assemble(ROBOT).q.tolist(), "part": "platform", "index": 0, "value": 0.05} | changes
    )


def test_the_page_is_at_the_address(server, ask):
    assert server.address == f"http://127.0.0.1:{server.server_port}/"
    assert server.server_address[0] == "127.0.0.1"
    assert ask("GET", "/") == (200, b"<p>the page</p>")
    assert ask("GET", "/else")[0] == 404
    assert ask("GET", "/../pyproject.toml")[0] == 404


def test_a_port_that_is_taken_is_refused_in_one_line(server):
    with pytest.raises(InvalidInput, match=f"port {server.server_port}: Address already in use") as refused:
        PageServer("", port=server.server_port)
    assert refused.value.remedy == {"port": None}


def test_a_slider_is_answered(ask):
    status, content = ask("POST", "/api/move", movement())
    told = json.loads(content)
    assert status == 200
    assert told["platform"][0] == pytest.approx(0.05, abs=1e-12)
    assert told["level"] == "regular"
    assert len(told["q"]) == ROBOT.model.nq


@pytest.mark.parametrize(
    "headers",
    [{"host": "example.org"}, {"host": "127.0.0.1"}, {"origin": "http://example.org"}, {"origin": "null"}],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_other_hosts_and_other_pages_get_nothing(ask, method, headers):
    status, content = ask(method, "/" if method == "GET" else "/api/move", movement(), **headers)
    assert status == 403
    assert b"only for this machine" in content


@pytest.mark.parametrize(
    "body",
    [
        "",
        "[]",
        "{",
        "\xff",
        movement(q=None),
        movement(q=[1e999]),
        movement(q="0"),
        movement(part="left"),
        movement(index=7),
        movement(value="far"),
        movement(value=float("nan")),
        "[" * 30000,
        "0" * (MAX_REQUEST_BYTES + 1),
    ],
)
def test_nonsense_is_refused_in_one_line(ask, body):
    status, content = ask("POST", "/api/move", body.encode("latin-1"))
    assert status == 400
    assert set(json.loads(content)) == {"error"}


def test_there_is_one_service(ask):
    assert ask("POST", "/api/else", movement())[0] == 404
