"""`motord watch`: the bench on one screen of a terminal, and keys to operate it.

Pure are `glyphs` (sparklines, too), `panels` and `layout` (the screen as lines). `feed` receives,
`operator_session` commands, `app` draws and takes keys.
"""
