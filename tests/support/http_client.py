"""Requests to a server of this machine, as any program makes them."""

import http.client
import json
from typing import Any


class Api:
    """The HTTP API on a port. Each call gives (status, headers, body): body as JSON where it is JSON, else bytes."""

    def __init__(self, port, **headers):
        self.port, self.headers = port, headers

    def __call__(self, method, path, body=None, **headers) -> tuple[int, dict[str, str], Any]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        sent = self.headers | {name.replace("_", "-"): value for name, value in headers.items()}
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
            sent = {"Content-Type": "application/json"} | sent
        connection.request(method, path, body=body, headers=sent)
        answer = connection.getresponse()
        data, kind = answer.read(), answer.getheader("content-type", "")
        connection.close()
        return answer.status, dict(answer.getheaders()), json.loads(data) if "json" in kind else data

    def get(self, path) -> Any:
        """The body of a GET that must succeed."""
        status, _, body = self("GET", path)
        assert status == 200, (path, status, body)
        return body
