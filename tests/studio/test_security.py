"""Attacks on a server that every page in a browser can reach, and on the files of whoever runs it."""

from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from ar_demo.studio import workspace as workspaces
from ar_demo.studio.app import application
from ar_demo.studio.security import Admission, AdmissionModel

from .conftest import ORIGIN, Studio


def stranger(studio: Studio, base: str = ORIGIN) -> TestClient:
    """A browser without a cookie."""
    return TestClient(application(studio.workspace, studio.admission), base, headers={"origin": base})


def test_nothing_is_told_without_the_cookie(studio: Studio) -> None:
    other = stranger(studio)
    for path in ("/", "/static/studio.js", "/api/projects", studio.url, f"{studio.url}/frames/0"):
        assert other.get(path).status_code == 401
    assert other.post("/api/projects", json={}).status_code == 401
    assert other.get("/", params={"token": "guess"}).status_code == 401
    with pytest.raises(WebSocketDisconnect), studio.socket(other):
        pass


def test_a_token_is_good_once_and_its_cookie_is_kept_from_scripts_and_other_sites() -> None:
    told: list[int] = []
    admission = Admission(lambda: told.append(1))
    token = admission.token
    assert token is not None
    cookie = admission.enter(token)
    assert cookie is not None
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(cookie.split("; "))
    assert admission.knows(cookie)
    assert not admission.knows(cookie.split("=")[0] + "=guess")
    assert not admission.knows("")
    assert admission.enter(token) is None
    assert told == [1]


def test_the_number_of_sessions_is_limited() -> None:
    admission = Admission(model=AdmissionModel(most_sessions=2))
    for _ in range(2):
        assert admission.token is not None
        assert admission.enter(admission.token) is not None
    assert admission.token is None
    assert admission.enter("None") is None


def test_the_cookie_is_set_and_the_token_leaves_the_address(studio: Studio) -> None:
    other = stranger(studio)
    answer = other.get("/", params={"token": studio.admission.token}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert "HttpOnly" in answer.headers["set-cookie"]
    assert other.get("/api/projects").status_code == 200


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example:80", ""])
def test_a_name_led_to_this_machine_is_refused(studio: Studio, host: str) -> None:
    """DNS rebinding: the page's own origin is evil.example, and so is the Host header."""
    for path in ("/", studio.url):
        assert studio.page.get(path, headers={"host": host, "origin": f"http://{host}"}).status_code == 403
    assert studio.page.put(studio.url, json={}, headers={"host": host, "origin": f"http://{host}"}).status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:1234", "[::1]:80"])
def test_the_near_end_of_a_tunnel_is_let_through(studio: Studio, host: str) -> None:
    answer = studio.page.post(f"{studio.url}/stop", headers={"host": host, "origin": f"http://{host}"})
    assert answer.status_code == 409  # nothing to stop


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "http://localhost", "null", ""])
def test_writes_and_sockets_of_other_origins_are_refused(studio: Studio, origin: str) -> None:
    headers = {"origin": origin}
    before = studio.content
    assert studio.page.put(studio.url, json=before, headers=headers).status_code == 403
    for path in ("/api/projects", "/api/uploads?name=a.png", f"{studio.url}/track", f"{studio.url}/stop"):
        assert studio.page.post(path, json={}, headers=headers).status_code == 403
    with pytest.raises(WebSocketDisconnect), studio.socket(origin=origin):
        pass
    with studio.socket():
        pass
    assert studio.content == before


def test_a_write_without_an_origin_is_refused(studio: Studio) -> None:
    page = TestClient(application(studio.workspace, studio.admission), ORIGIN, cookies=dict(studio.page.cookies))
    assert page.get(studio.url).status_code == 200
    assert page.put(studio.url, json=studio.content).status_code == 403


def test_every_answer_has_a_strict_policy(studio: Studio) -> None:
    answers = [
        studio.page.get("/api/projects"),
        studio.page.get("/nowhere"),
        stranger(studio).get("/"),
        studio.get("/frames/0"),
        studio.get("/frames/99"),
    ]
    for answer in answers:
        policy = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
        assert policy["default-src"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
        assert "unsafe" not in str(policy)
        assert policy["frame-ancestors"] == "'none'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize(
    "name", ["../app.py", "..%2fapp.py", "%2e%2e%2fapp.py", "....//app.py", "/etc/passwd", "app.py"]
)
def test_static_files_are_those_of_their_folder(studio: Studio, name: str) -> None:
    assert studio.page.get(f"/static/{name}").status_code == 404


def test_paths_are_no_ids(studio: Studio) -> None:
    for path in ("/etc/passwd", "street.mp4", "../../etc/passwd", str(studio.folder / "street.mp4")):
        assert studio.page.post("/api/projects", json={"video": path}).status_code == 404
        assert studio.page.get("/api/files", params={"folder": path}).status_code == 404
        assert studio.put(surface={"ad": path}).status_code == 404
    assert studio.page.get("/api/files/..%2f..%2fetc%2fpasswd/picture").status_code == 404


def test_links_that_lead_out_of_the_root_lead_nowhere(studio: Studio) -> None:
    outside = studio.folder.parent / "shots-private"  # which begins as the root does
    outside.mkdir()
    (outside / "secret.png").write_bytes((studio.folder / "ad.png").read_bytes())
    (studio.folder / "link.png").symlink_to(outside / "secret.png")
    (studio.folder / "door").symlink_to(outside)
    (studio.folder / "later.png").write_bytes((studio.folder / "ad.png").read_bytes())
    listing = studio.page.get("/api/files", params={"kind": "ad"}).json()
    ids = {file["name"]: file["id"] for file in listing["files"]}
    assert ids.keys() == {"ad.png", "later.png", "street.mp4"}
    assert listing["folders"] == []
    assert studio.page.get(f"/api/files/{ids['later.png']}/picture").status_code == 200
    (studio.folder / "later.png").unlink()
    (studio.folder / "later.png").symlink_to(outside / "secret.png")
    assert studio.page.get(f"/api/files/{ids['later.png']}/picture").status_code == 404


def test_only_what_was_named_can_be_had_without_a_root(folder: Path) -> None:
    files = workspaces.Workspace(folder, None, workspaces.Defaults()).files
    files.admit(folder / "street.mp4")
    listing = files.listing("ad")
    assert [file["name"] for file in listing["files"]] == ["street.mp4"]
    assert (listing["folder"], listing["folders"]) == (None, [])


def test_an_upload_that_is_too_large_leaves_nothing(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspaces, "MOST_UPLOAD_BYTES", 1000)
    before = sorted(studio.folder.iterdir())

    def chunks() -> object:
        for _ in range(100):
            yield bytes(100)

    for content in (bytes(1001), chunks()):  # with a length, and in pieces without one
        answer = studio.page.post("/api/uploads", params={"name": "big.png"}, content=content)  # type: ignore[arg-type]
        assert (answer.status_code, answer.json()["field"]) == (413, "ad")
    assert sorted(studio.folder.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "status"), [("../../evil.png", 201), ("..\\evil.png", 201), ("evil.py", 415), ("", 415), (".png", 415)]
)
def test_an_upload_stays_in_its_folder_under_a_free_name(studio: Studio, name: str, status: int) -> None:
    before = {path.name for path in studio.folder.iterdir()}
    data = (studio.folder / "ad.png").read_bytes()
    assert studio.page.post("/api/uploads", params={"name": name}, content=data).status_code == status
    made = {path.name for path in studio.folder.iterdir()} - before
    assert made == ({"evil.png"} if status == 201 else set())
    assert [path.name for path in studio.folder.parent.iterdir()] == ["shots"]


def test_an_upload_that_is_no_picture_is_refused(studio: Studio) -> None:
    answer = studio.page.post("/api/uploads", params={"name": "ad.png"}, content=b"<script>")
    assert answer.status_code == 415
    assert "ad.png" in answer.json()["error"]
    assert str(studio.folder) not in answer.text
    assert not (studio.folder / "ad.1.png").exists()


def test_a_body_that_is_too_long_is_refused(studio: Studio) -> None:
    assert studio.page.put(studio.url, content=b" " * (5 << 20)).status_code == 413


def test_the_number_of_open_videos_is_limited(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspaces, "MOST_PROJECTS", 1)
    (studio.folder / "other.mp4").write_bytes((studio.folder / "street.mp4").read_bytes())
    files = studio.page.get("/api/files").json()["files"]
    ids = {file["name"]: file["id"] for file in files}
    assert studio.page.post("/api/projects", json={"video": ids["street.mp4"]}).status_code == 201  # open already
    answer = studio.page.post("/api/projects", json={"video": ids["other.mp4"]})
    assert answer.status_code == 429
