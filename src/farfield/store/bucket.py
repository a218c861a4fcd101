"""A store in a bucket: S3, Google Cloud Storage or Azure, and whatever speaks like one of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from datetime import timedelta
from typing import TYPE_CHECKING, Never

from farfield.errors import MissingExtraError, MissingKeyError, OptionError, StoreError
from farfield.store.keys import check_key, check_prefix, is_key

if TYPE_CHECKING:
    from obstore.store import ObjectStore

SCHEMES = {"s3": "AWS_…", "gs": "GOOGLE_…", "az": "AZURE_…"}
"""Schemes of URLs → how the variables of the environment begin that hold endpoint, region and credentials."""

CONNECT_SECONDS = 5
"""Within which a connection must be there."""

SILENT_SECONDS = 60
"""Within which an answer must begin, and each next part of it come."""

REQUEST_SECONDS = 600
"""Within which all of it must be there: 64 MB at 1 Mbit/s."""

RETRIES = 3
RETRY_SECONDS = 20
"""After which nothing is tried again. obstore's own limits are 10 times and 3 minutes: long to sit before nothing."""

_TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".json": "application/json"}
"""A bucket that is a web site sends what was said when a value was put; browsers run no script of another type."""

_NO_CREDENTIALS = ("169.254.169.254", "metadata.google.internal", "Account must be specified", "token request")
_NO_BUCKET = ("NoSuchBucket", "The specified bucket does not exist", "ContainerNotFound")


class BucketStore:
    """Keeps the contract of `Store` below a URL `s3://BUCKET/PREFIX`, `gs://…` or `az://…`, but for one thing: no
    `put` is refused because its key is the folder of others. A bucket has no folders, and to ask for them would take
    a request for each level of each key; keys of the format never meet so.

    Endpoint, region and credentials come from the environment, as obstore describes.
    """

    def __init__(self, url: str) -> None:
        """Opens no connection yet.

        Raises MissingExtraError: obstore is not installed. StoreError: a URL, or settings, that cannot be used.
        """
        scheme, _, rest = url.partition("://")
        self._url = f"{scheme}://{rest.rstrip('/')}"
        self._store = _open(self._url)

    def __reduce__(self) -> tuple[type[BucketStore], tuple[str]]:
        return BucketStore, (self._url,)

    @property
    def location(self) -> str:
        """The URL, as it was given."""
        return self._url

    def get(self, key: str) -> bytes:
        """See `Store.get`."""
        try:
            return bytes(self._store.get(check_key(key)).bytes())
        except _errors() as error:
            self._fail(error, key, "cannot be read")

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """See `Store.get_range`."""
        if start < 0 or length < 0:
            raise OptionError("a byte range cannot be negative", key)
        if length == 0:
            self.size(key)
            return b""
        try:
            return bytes(self._store.get_range(check_key(key), start=start, length=length))
        except _errors() as error:
            # There is no error of its own for a range that begins where the value has ended.
            if not isinstance(error, FileNotFoundError) and start >= self.size(key):
                return b""
            self._fail(error, key, "cannot be read")

    def put(self, key: str, data: bytes) -> None:
        """See `Store.put`: buckets store all of an object or nothing."""
        kind = _TYPES.get(key[key.rfind(".") :])
        try:
            self._store.put(check_key(key), data, attributes={"Content-Type": kind} if kind else None)
        except _errors() as error:
            self._fail(error, key, "cannot be written")

    def writing(self) -> AbstractContextManager[None]:
        """See `Store.writing`: everyone gets it."""
        return nullcontext()

    def exists(self, key: str) -> bool:
        """See `Store.exists`."""
        try:
            self.size(key)
        except MissingKeyError:
            return False
        return True

    def size(self, key: str) -> int:
        """See `Store.size`."""
        try:
            return self._store.head(check_key(key))["size"]
        except _errors() as error:
            self._fail(error, key, "cannot be read")

    def delete(self, key: str) -> None:
        """See `Store.delete`."""
        try:
            self._store.delete(check_key(key))
        except FileNotFoundError:
            # Some services say so, others do not.
            return
        except _errors() as error:
            self._fail(error, key, "cannot be removed")

    def list(self, prefix: str = "") -> Iterator[str]:
        """See `Store.list`. All keys that it gives are gathered first: a bucket's own order is another."""
        folder = check_prefix(prefix)
        try:
            pages = self._store.list(folder or None)
            keys = [entry["path"] for page in pages for entry in page if is_key(entry["path"])]
        except _errors() as error:
            self._fail(error, prefix, "cannot be listed")
        yield from sorted(keys, key=lambda key: key.split("/"))

    def holds_any(self, prefix: str = "") -> bool:
        """Whether anything is stored below the folder `prefix`, found out with one request. Raises StoreError."""
        try:
            return any(page for page in self._store.list(prefix or None, chunk_size=1))
        except _errors() as error:
            self._fail(error, prefix, "cannot be listed")

    def _fail(self, error: Exception, key: str, what: str) -> Never:
        fail(error, self._url, key, what)


def fail(error: Exception, url: str, key: str, what: str) -> Never:
    """Raises the StoreError that says what a service's error means."""
    where = f"{url}: {key}" if key else url
    text = str(error)
    variables = SCHEMES[url.partition(":")[0]]
    if any(sign in text for sign in _NO_BUCKET):
        raise StoreError("there is no such bucket", url, "make it first, or check its name and region") from error
    if isinstance(error, FileNotFoundError):
        raise MissingKeyError("nothing is stored there", where) from error
    if any(sign in text for sign in _NO_CREDENTIALS):
        raise StoreError("no credentials", url, f"set those of the service in the environment: {variables}") from error
    reason = text.partition("\n")[0].removesuffix(":")
    if type(error).__name__ in ("PermissionDeniedError", "UnauthenticatedError"):
        raise StoreError(f"{what}: permission denied", where, f"check the credentials: {variables}") from error
    hint = f"check the network, and the endpoint in the environment: {variables}"
    raise StoreError(f"{what}: {reason}", where, hint) from error


def _open(url: str) -> ObjectStore:
    try:
        from obstore.store import from_url
    except ImportError:
        raise MissingExtraError("buckets need obstore", "cloud", url) from None
    scheme, _, rest = url.partition("://")
    if not rest or rest.startswith("/"):
        raise StoreError("names no bucket", url, f"{scheme}://BUCKET/FOLDER")
    try:
        return from_url(
            url,
            # An endpoint that begins with http:// stands in the environment because somebody wants it so.
            client_options={
                "allow_http": True,
                "connect_timeout": timedelta(seconds=CONNECT_SECONDS),
                "read_timeout": timedelta(seconds=SILENT_SECONDS),
                "timeout": timedelta(seconds=REQUEST_SECONDS),
            },
            retry_config={"max_retries": RETRIES, "retry_timeout": timedelta(seconds=RETRY_SECONDS)},
        )
    except _errors() as error:
        fail(error, url, "", "cannot be opened")


def _errors() -> tuple[type[Exception], ...]:
    """What obstore raises."""
    from obstore.exceptions import BaseError

    return BaseError, OSError, ValueError
