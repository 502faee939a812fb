lumpwatch train site.yaml first.mkv first.txt --camera view1 --roi plaza --folds 0
lumpwatch replay site.yaml second.mkv --camera view1 --out out
lumpwatch evaluate out/states.jsonl second.txt --json
