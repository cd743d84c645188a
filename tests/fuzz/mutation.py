"""Inputs that are nearly right: values, keys, lines and bytes of good ones, changed at random."""

import copy
import json

import yaml

HOSTILE = (
    *(0, -1, 1, 2, 1e-9, 1e-300, 5e-324, -1e-3, 1e6, 1e9, 1e300, 2**31, 2**63, 10**40),
    *(float("inf"), float("-inf"), float("nan"), True, False, None),
    *("", " ", "0", "nan", "1e400", "1e400 m", "-0 mm", "1 ns", "1e9 GHz", "5 kg", "30 deg"),
    *("all", "auto", "home", "none", "palida", "~", "../../x", "/", "/dev/null", "a" * 300),
    *("\x00", "\x1b[2J", "\u202e", "\ud83d\ude00", "%s%n{0}", "{shown}", "<script>", "\\input{x}"),
    *([], [[]], {}, {"a": 1}, [1] * 5, [1] * 7, ["x"] * 1000, [[1, 2]] * 6, {"": ""}),
    *({"format": "csv"}, [None] * 6, [float("nan")] * 6, [1e308] * 6, [0] * 6, "&a", "*a", "!!x"),
)
"""What stands in a file by mistake or by intent."""

MARKS = (
    *(b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\x1b[2J", b"\n", b"\r", b"\t", b'"', b"'", b","),
    *(b";", b":", b"- ", b"{", b"}", b"[", b"]", b"&a ", b"*a ", b"<<: ", b"!!python/none ", b"#"),
    *(b"nan", b"inf", b"1e999", b"-", b".", b"\xc3\x28", b"\xed\xa0\x80", b"0" * 400, b"<", b">"),
    *(b"</", b"<!DOCTYPE x>", b"&#0;", b"]]>", b"%", b"../", b"\xff\xff\xff\xff\xff\xff\xff\x7f"),
)


def changed_bytes(content, rng):
    """Return bytes with one to four of them, or parts of them, changed."""
    data = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(len(data) + 1)
        end = min(len(data), place + rng.choice((1, 2, 8, 64, 512)))
        kind = rng.randrange(8)
        if kind == 0 and data:
            data[min(place, len(data) - 1)] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[place:end] = rng.choice(MARKS)
        elif kind == 2:
            data[place:place] = rng.choice(MARKS)
        elif kind == 3:
            del data[place:end]
        elif kind == 4:
            del data[place:]
        elif kind == 5:
            data[place:place] = data[place:end] * rng.choice((1, 2, 50))
        elif kind == 6:
            data[place:end] = bytes(rng.randrange(256) for _ in range(end - place))
        else:
            source = rng.randrange(len(data) + 1)
            data[place:end] = data[source : source + end - place]
    return bytes(data)


def changed_lines(content, rng):
    """Return text with lines left out, put twice, swapped, or with a cell changed."""
    lines = content.split(b"\n")
    for _ in range(rng.randint(1, 3)):
        place = rng.randrange(len(lines))
        kind = rng.randrange(5)
        if kind == 0:
            del lines[place]
            lines = lines or [b""]
        elif kind == 1:
            lines[place:place] = [lines[place]] * rng.choice((1, 2, 100))
        elif kind == 2:
            other = rng.randrange(len(lines))
            lines[place], lines[other] = lines[other], lines[place]
        else:
            mark = next((m for m in (b",", b"\t", b";", b" ") if m in lines[place]), b",")
            cells = lines[place].split(mark)
            cell = rng.choice((*MARKS, *(str(h).encode("utf-8", "replace") for h in HOSTILE)))
            cells[rng.randrange(len(cells))] = cell
            lines[place] = mark.join(cells)
    return b"\n".join(lines)


def places(data, path=()):
    """Yield the path of every value in plain data."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list) and value:
            yield from places(value, (*path, key))


def at(data, path):
    for key in path:
        data = data[key]
    return data


def misspelt(key, rng):
    if not isinstance(key, str) or not key:
        return "x"
    place = rng.randrange(len(key))
    return rng.choice(
        (key[:place] + key[place + 1 :], key.upper(), key + "s", key + " ", "é" + key)
    )


def changed_data(data, rng, hostile=HOSTILE):
    """Return plain data with one to three values or keys changed, moved, left out or put in."""
    data = copy.deepcopy(data)
    for _ in range(rng.randint(1, 3)):
        every = list(places(data))
        if not every:
            return {"a": rng.choice(hostile)}
        *inside, key = rng.choice(every)
        holder = at(data, inside)
        kind = rng.randrange(8)
        if kind == 0:
            del holder[key]
        elif kind == 1:
            *other, name = rng.choice(every)
            with_value = at(data, other)
            if isinstance(name, int) or name in with_value:
                holder[key] = copy.deepcopy(with_value[name])
        elif kind == 2 and isinstance(holder, dict):
            holder[misspelt(key, rng)] = holder.pop(key)
        elif kind == 3 and isinstance(holder, dict):
            holder[rng.choice(("unknown", "", "1", "a" * 400, "naïve", "\x1b"))] = rng.choice(
                hostile
            )
        elif kind == 4 and isinstance(holder[key], int | float):
            holder[key] = holder[key] * rng.choice((-1, 0, 1e-12, 1e3, 1e12, 1e300))
        else:
            holder[key] = copy.deepcopy(rng.choice(hostile))
    return data


def changed_yaml(data, rng, hostile=HOSTILE):
    """Return a YAML file: mostly well-formed with wrong content, else with wrong bytes too."""
    if rng.random() < 0.8:
        data = changed_data(data, rng, hostile)
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=200)
    content = text.encode("utf-8", "surrogatepass")
    return content if rng.random() < 0.7 else changed_bytes(content, rng)


def changed_json(content, rng):
    """Return a JSON file: mostly well-formed with wrong content, else with wrong bytes."""
    if rng.random() < 0.3:
        return changed_bytes(content, rng)
    hostile = [h for h in HOSTILE if not (isinstance(h, str) and "\ud800" <= h[:1] <= "\udfff")]
    return json.dumps(changed_data(json.loads(content), rng, hostile)).encode()
