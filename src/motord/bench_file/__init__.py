"""A first bench file: an example that ships with motord, adapted by answers, with a comment a key.

`templates` are the examples, `questions` what is asked of each, `parsing` makes values of answers,
`content` puts them in, `commented` writes it as TOML. `new.new_bench_file` does all of it and
checks the result.
"""
