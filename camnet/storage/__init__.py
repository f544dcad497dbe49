"""Files and folders on disk: written whole or not at all, and checked when they are read back.

Writing: `whole_file` for one file, `partial` and `marker` for a folder, `lock` against two writers. Reading:
`json_file`, `archive` (arrays), `table` (Parquet), each with limits on size; `seal` finds any change of what was
written. Nothing here knows what the files mean. Start with `whole_file` and `archive`.
"""
