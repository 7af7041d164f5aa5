"""Messages in the text of a compiled program."""

import re
from typing import NamedTuple

RUNS = re.compile(r"(?:body|condition|to_apply|true_computation|false_computation)=%?([\w.\-]+)")
MESSAGES = ("all-reduce", "collective-permute", "all-gather", "all-to-all", "reduce-scatter")
BLOCKS = ("while", "conditional", "call")


class Instruction(NamedTuple):
    """Of a computation: its operation, names of its operands, and of the computations that it runs."""

    operation: str
    operands: list[str]
    runs: list[str]


def computations(text):
    """Instructions by name, of all computations by name, in HLO."""
    found, here = {}, {}
    for line in text.splitlines():
        head = re.match(r"(?:ENTRY )?%?([\w.\-]+) \(.*\{\s*$", line)
        if head:
            here = found.setdefault(head[1], {})
        elif instruction := re.match(r"\s+(?:ROOT )?%?([\w.\-]+) = (.*)$", line):
            name, rest = instruction.groups()
            # A type is one word, or several in brackets.
            rest = rest[_closing(rest, 0) + 1 :] if rest.startswith("(") else rest.partition(" ")[2]
            operation = rest.strip().partition("(")[0]
            end = _closing(rest, rest.find("("))
            runs = re.findall(
                r"(?:body|condition|to_apply|true_computation|false_computation)=%?([\w.\-]+)", rest[end:]
            )
            for branches in re.findall(r"branch_computations=\{([^}]*)\}", rest[end:]):
                runs += [one.strip().lstrip("%") for one in branches.split(",")]
            here[name] = Instruction(operation, re.findall(r"%([\w.\-]+)", rest[:end]), runs)
    return found


def _closing(text, start):
    depth = 0
    for place in range(start, len(text)):
        depth += (text[place] == "(") - (text[place] == ")")
        if not depth:
            return place
    return len(text)


def unordered_messages(text):
    """Pairs of a block with messages and a message, or another such block, of which neither needs what the other gives.

    Such a pair may come in one order on one device and in the other on another.
    """
    all_, known = computations(text), {}

    def sends(name):
        if name not in known:
            known[name] = any(is_message(one) or is_block(one) for one in all_.get(name, {}).values())
        return known[name]

    def is_message(one):
        return one.operation.removesuffix("-start") in MESSAGES

    def is_block(one):
        return one.operation in BLOCKS and any(map(sends, one.runs))

    found = []
    for here in all_.values():
        both = [name for name, one in here.items() if is_message(one) or is_block(one)]
        needs = {name: _needed(here, name) for name in both}
        pairs = ((a, b) for k, a in enumerate(both) for b in both[k + 1 :])
        found += [
            (a, b)
            for a, b in pairs
            if (is_block(here[a]) or is_block(here[b])) and a not in needs[b] and b not in needs[a]
        ]
    return found


def _needed(instructions, name):
    found, left = set(), [name]
    while left:
        for one in instructions.get(left.pop(), Instruction("", [], [])).operands:
            if one not in found:
                found.add(one)
                left.append(one)
    return found
