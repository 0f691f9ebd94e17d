"""Commands of pkmcal: a module for each, imported when the command is named."""

# Every module has a function `command`. Its parameters are its command line (app/options.py): a
# `Terminal` is --json, a `Campaign` is DIR, a dataclass of options is an option for each field. The
# docstring is the help text; its first line is repeated in `app.main.COMMANDS`, so that the list of
# commands imports none of them.
#
# A command is short, because the work is done elsewhere: campaigns/workflow decides and writes, the
# command asks the operator, prints the answer, and ends with the command that comes next:
#
#     answer = work(campaign, options)             raises when something is wrong
#     terminal.say(…)                              for people
#     following = tell_next(terminal, campaign)    printed, and returned for the document
#     terminal.conclude(answer, following, is_good=…)    the document; exit code 1 if not good
#
# Answers are dataclasses or dictionaries: their fields are the keys of the --json document, which
# programs rely on.
