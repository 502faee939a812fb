lumpwatch replay site.yaml clip.mkv --camera road --out out
lumpwatch evaluate out/states.jsonl clip.txt --json
