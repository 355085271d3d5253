#!/usr/bin/python3
"""Puts every sentence of Markdown files on a line of its own.

A change of one sentence is then a change of one line. Front matter, code, formulas between lines of
`$$`, tables, headings, comments and HTML stay as they are. The text that a reader sees does not
change.

    tools/format_markdown.py FILE...            rewrites the files
    tools/format_markdown.py --check FILE...    names the files that would change; the exit status
                                                is then 1
"""
import argparse
import pathlib
import re
import sys

#: texts that end with a full stop and do not end a sentence
ABBREVIATIONS = (
    r'(?:\b(?:e\.g|i\.e|cf|vs|al|[Ee]qs?|[Ff]igs?|[Nn]o|[Ss]ec|[Cc]h|pp?|approx|resp|Phys|Chem|Rev'
    r'|Lett|Mech|Comput|Comm|Math|Sci|Soc|Proc|Acad|Theory|Ann|Mol|Biol|Vol|St|Dr|Trans|Camb|Phil'
    r'|Lond|Eng|Int|ibid)\.|(?<![0-9\x01] )\b[A-Z]\.)$')  # "300 K." ends a sentence, "J." does not
SENTENCE_END = re.compile(r'(?<=[.!?])(?P<close>[)"\'*_\]]*)\s+(?=[A-Z(\[*_"\x00ÄÖÜÉΔΓΦΨΩ])')
#: inline code, inline formulas, images, links and addresses: never split
ATOM = re.compile(r'(`+)(?!`).+?(?<!`)\1(?!`)|\$[^$\n]+\$|!?\[[^\[\]]*\]\([^)\s]*\)'
                  r'|\]\([^)\s]*\)|<https?:[^>]*>')
ITEM = re.compile(r'^(\s*)([-*+]|\d+[.)])(\s+)(?=\S)')
FENCE = re.compile(r'^\s*(```+|~~~+|:::+)')
VERBATIM = re.compile(r'^\s*(#{1,6}\s|\||<|\[[^\]]+\]:\s|\(\S+\)=\s*$|---+\s*$|===+\s*$|:\S+:|%)')


def sentences(text):
    """The sentences of a paragraph without line breaks."""
    atoms = []

    def hide(match):
        atoms.append(match.group())
        return f'\x00{len(atoms) - 1}\x01'

    def show(part):
        return re.sub('\x00(\\d+)\x01', lambda match: atoms[int(match.group(1))], part)

    hidden = ATOM.sub(hide, text)
    found, begin = [], 0
    for match in SENTENCE_END.finditer(hidden):
        before = hidden[begin:match.start()]
        if re.search(ABBREVIATIONS,
                     before) or before.count('(') > (before + match['close']).count(')'):
            continue
        found.append(show(hidden[begin:match.end('close')]))
        begin = match.end()
    return [*found, show(hidden[begin:])]


def format_text(text):
    """The whole of a Markdown file with a sentence a line."""
    result, paragraph = [], []
    first, rest = '', ''
    fence = ''
    inside = 0  # how far the text of the last list item is indented, 0 outside lists

    def flush():
        if paragraph:
            parts = sentences(' '.join(line.strip() for line in paragraph))
            result.append(first + parts[0])
            result.extend(rest + part for part in parts[1:])
            paragraph.clear()

    lines = text.splitlines()
    matter = lines.index('---', 1) + 1 if lines[:1] == ['---'] and '---' in lines[1:] else 0
    result.extend(lines[:matter])
    for line in lines[matter:]:
        if fence:
            result.append(line)
            if line.strip() == fence or (fence != '$$' and line.strip().startswith(fence)):
                fence = ''
            elif fence == '$$' and line.strip().endswith('$$'):
                fence = ''
            continue
        opening = FENCE.match(line)
        if opening or re.match(r'^\s*\$\$', line):
            flush()
            result.append(line)
            if opening:
                fence = opening.group(1)
            elif not (line.strip() != '$$' and line.strip().endswith('$$')):
                fence = '$$'
            continue
        indent = len(line) - len(line.lstrip())
        if line.strip() and not paragraph and indent < inside:
            inside = 0
        code = not paragraph and indent >= inside + 4 and not ITEM.match(line)
        if not line.strip() or VERBATIM.match(line) or code:
            flush()
            result.append(line)
            continue
        item = ITEM.match(line)
        quote = re.match(r'^\s*>\s?', line)
        if item:
            flush()
            first = item.group()
            rest = ' '*len(first)
            inside = len(first)
            paragraph.append(line[item.end():])
        elif quote:
            if not (paragraph and first == quote.group()):
                flush()
                first = rest = quote.group()
            paragraph.append(line[quote.end():])
        else:
            if not paragraph:
                first = rest = re.match(r'^\s*', line).group()
            paragraph.append(line)
        if line.endswith('  ') or line.endswith('\\'):
            ending = '' if line.endswith('\\') else '  '
            flush()
            result[-1] += ending
            first = rest
    flush()
    return '\n'.join(result) + '\n'


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('files', nargs='+', type=pathlib.Path)
    parser.add_argument('--check', action='store_true',
                        help='write nothing; name the files that would change')
    arguments = parser.parse_args()
    changed = []
    for file in arguments.files:
        text = file.read_text()
        formatted = format_text(text)
        if formatted != text:
            changed.append(file)
            if not arguments.check:
                file.write_text(formatted)
    for file in changed:
        print(file)
    sys.exit(bool(arguments.check and changed))


if __name__ == '__main__':
    main()
