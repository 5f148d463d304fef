"""What is text, of the names that the system knows."""


def is_text(name: str) -> bool:
    r"""Whether it is UTF-8: the system passes bytes that are no text on as lone surrogates.

    >>> is_text("ü"), is_text("\udcfc")
    (True, False)
    """
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
