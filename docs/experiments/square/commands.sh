lumpwatch train site.yaml train0.mkv train0.txt train1.mkv train1.txt --camera cam --roi all --folds 0
lumpwatch replay site.yaml test0.mkv --camera cam --out out/test0
lumpwatch replay site.yaml test1.mkv --camera cam --out out/test1
lumpwatch replay site.yaml empty.mkv --camera cam --out out/empty
python -m docs.experiments.held out/test0/states.jsonl test0.txt out/test1/states.jsonl test1.txt out/empty/states.jsonl
